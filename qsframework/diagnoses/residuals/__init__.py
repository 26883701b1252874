"""What a fitted model leaves: noise, gross rows, lack of fit."""
