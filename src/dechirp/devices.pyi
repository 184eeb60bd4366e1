# Written by tests/test_api.py.

from dechirp.radar.devices.bgt60tr13c import Bgt60tr13c as Bgt60tr13c
from dechirp.radar.devices.ti import Cascade as Cascade
from dechirp.radar.devices.ti import Xwr1443 as Xwr1443
from dechirp.radar.devices.ti import Xwr1642 as Xwr1642
from dechirp.radar.devices.ti import Xwr1843 as Xwr1843
from dechirp.radar.devices.ti import Xwr1843aop as Xwr1843aop
from dechirp.radar.devices.ti import Xwr2243 as Xwr2243
from dechirp.radar.devices.ti import Xwr2944 as Xwr2944
from dechirp.radar.devices.ti import Xwr6843 as Xwr6843
from dechirp.radar.devices.ti import Xwr6843aop as Xwr6843aop
from dechirp.radar.devices.ti import Xwr6843ods as Xwr6843ods
from dechirp.recordings.settings.write_ti_cfg import format_ti_cfg as format_ti_cfg
