"""The errors of an array, from what a reflector at known places sends back."""
