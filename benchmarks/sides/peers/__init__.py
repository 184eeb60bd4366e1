"""Other packages: requirements, and one function per supported kind of job.

A function takes the inputs of a job and returns the timed call. Packages are imported inside the
functions, so that these modules can be imported without them.
"""
