# Written by tests/test_api.py.

from dechirp.recordings.slow_time_files import read_slow_time as read_slow_time
