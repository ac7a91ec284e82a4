"""Reports: pages, figures and sentences made from results."""
