"""
A page for whoever stands at the machine: read only, in a process of its own.

`view` is what it shows, as data; `server` hands it to browsers; `__main__` looks at the machine.
The page itself is in config/panel.
"""
