"""Programs for commissioning and calibration, which no module of the machine imports."""
