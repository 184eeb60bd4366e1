# Written by tests/test_api.py.

from dechirp.results.object_lists.can_bus import CanFd as CanFd
from dechirp.results.object_lists.can_frames import largest_bus_load as largest_bus_load
from dechirp.results.object_lists.can_layout import DbcLayout as DbcLayout
from dechirp.results.object_lists.can_layout import read_dbc_layout as read_dbc_layout
from dechirp.results.object_lists.can_logs import read_can_log as read_can_log
from dechirp.results.object_lists.can_logs import receive_can as receive_can
from dechirp.results.object_lists.can_logs import send_can as send_can
from dechirp.results.object_lists.can_logs import write_can_log as write_can_log
from dechirp.results.object_lists.can_mapping import CanMapping as CanMapping
from dechirp.results.object_lists.can_mapping import MappedSignal as MappedSignal
from dechirp.results.object_lists.can_mapping import StatusSignal as StatusSignal
from dechirp.results.object_lists.can_mapping import VendorLayout as VendorLayout
from dechirp.results.object_lists.can_mapping import read_vendor_layout as read_vendor_layout
from dechirp.results.object_lists.ethernet import open_receiver as open_receiver
from dechirp.results.object_lists.ethernet import receive_datagrams as receive_datagrams
from dechirp.results.object_lists.ethernet import send_datagrams as send_datagrams
from dechirp.results.object_lists.files import read_objects as read_objects
from dechirp.results.object_lists.files import write_objects as write_objects
from dechirp.results.object_lists.measured_detections import objects_to_detections as objects_to_detections
