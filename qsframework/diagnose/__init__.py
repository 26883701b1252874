"""What the model gets wrong, which cause explains it, and what the extended model gains."""
