"""Which of the candidate causes the readings call for, and how surely."""
