"""One file a provider: causes of the arm, laws that nobody has written, conventions, and slips of a table."""
