"""Pages, figures and sentences that say what a run, a fit, a diagnosis or a calibration gave."""
