"""Pages, figures and sentences that report a run, a fit, a diagnosis or a calibration."""
