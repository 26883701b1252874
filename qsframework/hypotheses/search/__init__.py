"""Which of the catalogue's causes and places the readings call for, and how surely."""
