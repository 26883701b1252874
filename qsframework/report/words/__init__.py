"""All prose on results: one file for each noun, functions from values to sentences, in the field's terms."""
