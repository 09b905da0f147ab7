"""The drives: `canopen` (the bus), `cia402` (the axes), `controller` (the cycle)."""
