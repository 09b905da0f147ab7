"""The nodes, one executable a file: parameters, pure core, publishers."""
