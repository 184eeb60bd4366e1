"""Object lists: CAN FD, Ethernet, ASAM OSI, point clouds and tables."""

from dechirp.core.namespaces import lazy_getattr_and_dir

__getattr__, __dir__ = lazy_getattr_and_dir(__name__, "dechirp.results.object_lists")
