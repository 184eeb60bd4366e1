"""Other packages: their requirements, and a function for each supported kind of job.

A function takes the inputs of a job and returns what is timed. Nothing is imported outside of
them, so that the files can be read where a package is not installed.
"""
