"""The simulated machine and its world. No part of the machine imports it."""
