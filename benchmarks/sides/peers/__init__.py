"""Other packages, a file each: what pip installs, and a function for each kind of job it has.

A function takes the inputs of a job and returns what is timed. Nothing is imported outside of
them, so that the files can be read where a package is not installed.
"""
