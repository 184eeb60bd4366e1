# Written by tests/test_api.py.

from dechirp.tracking.group_tracker import GroupTracker as GroupTracker
from dechirp.tracking.groups import GroupTrack as GroupTrack
from dechirp.tracking.groups import LiveGroupTracker as LiveGroupTracker
from dechirp.tracking.groups import track_groups as track_groups
