"""Robot programmes that exist already: read with every motion accounted for, corrected, written back."""
