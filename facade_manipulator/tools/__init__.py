"""Programs for people at the machine: they see it, and it sees none of them."""
