"""qsframework: elastostatic calibration of heavy, quasi-serial industrial robots."""
