"""DBCs of vendor radars for tests: the names and scales of real ones, with fewer objects."""

TRACK = """\
BO_ {id} TRACK_A_{n}: 8 XXX
 SG_ COUNTER : 7|8@0+ (1,0) [0|255] "" XXX
 SG_ LAT_DIST : 31|11@0- (0.04,0) [-50|50] "m" XXX
 SG_ LONG_DIST : 15|13@0+ (0.04,0) [0|300] "m" XXX
 SG_ REL_SPEED : 47|12@0- (0.025,0) [-100|100] "m/s" XXX
 SG_ VALID : 48|1@0+ (1,0) [0|1] "" XXX
 SG_ CHECKSUM : 63|8@0+ (1,0) [0|255] "" XXX
"""
TARGET = """\
BO_ {id} Target{n}: 8 XXX
 SG_ CAN_TX_TRACK_WIDTH : 37|4@0+ (0.5,0) [0|7.5] "" XXX
 SG_ CAN_TX_TRACK_STATUS : 15|3@0+ (1,0) [0|7] "" XXX
 SG_ CAN_TX_TRACK_ROLLING_COUNT : 38|1@0+ (1,0) [0|1] "" XXX
 SG_ CAN_TX_TRACK_RANGE_RATE : 53|14@0- (0.01,0) [-81.92|81.91] "m/s" XXX
 SG_ CAN_TX_TRACK_RANGE : 18|11@0+ (0.1,0) [0|204.7] "m" XXX
 SG_ CAN_TX_TRACK_ANGLE : 12|10@0- (0.1,0) [-51.2|51.1] "" XXX
"""
LISTED = """\
BO_ 1546 Status: 2 XXX
 SG_ NofObjects : 0|8@1+ (1,0) [0|255] "" XXX

BO_ 1547 General: 8 XXX
 SG_ ID : 0|8@1+ (1,0) [0|255] "" XXX
 SG_ X : 8|16@1+ (0.2,-500) [-500|1138.2] "m" XXX
 SG_ Y : 24|12@1+ (0.2,-204.6) [-204.6|204.8] "m" XXX
 SG_ VX : 36|12@1+ (0.25,-512) [-512|511.75] "km/h" XXX

BO_ 1548 Quality: 8 XXX
 SG_ ID : 0|8@1+ (1,0) [0|255] "" XXX
 SG_ RCS : 8|8@1+ (0.5,-64) [-64|63.5] "dB" XXX
"""
LISTED_MAPPING = """\
messages: [General, Quality]
number: ID
start: Status
x: {signal: X}
y: {signal: Y}
vx: {signal: VX, unit: km/h}
snr: {signal: RCS, unit: dB, offset: 20}
"""


def dbc_text(messages: str) -> str:
    """Return the text of a DBC with messages."""
    return f'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: XXX\n\n{messages}'


def numbered_messages(template: str, first_id: int, numbers: range) -> str:
    """Return messages from a template, one for each number."""
    return "\n".join(
        template.format(id=first_id + index, n=number) for index, number in enumerate(numbers)
    )


TOYOTA = dbc_text(numbered_messages(TRACK, 528, range(16)))
ESR = dbc_text(numbered_messages(TARGET, 1280, range(1, 9)))
LISTS = dbc_text(LISTED)
