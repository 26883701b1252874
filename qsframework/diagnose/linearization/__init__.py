"""The readings and every candidate cause as whitened columns about the fitted model."""
