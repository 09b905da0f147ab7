"""Programs for commissioning and calibration; no module of the machine imports them."""
