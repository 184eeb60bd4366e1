"""The sides of `side_by_side.py`: what each does of a job, and how they are run in turns."""
