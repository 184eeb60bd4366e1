"""Fuzzer of the messages to a studio page, which must report invalid ones and stay usable.

    python fuzz/studio.py --seconds 60

Each seed gives 400 random messages, some of them sent simultaneously. A failure prints the seed.
"""

import argparse
import logging
import sys
import time
import traceback
import warnings
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "tests"))


def main() -> None:
    from bad_input.studio_page import send_random_messages

    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--seconds", type=int, default=60, help="time limit")
    parser.add_argument("--seed", type=int, default=1, help="first seed")
    options = parser.parse_args()
    logging.basicConfig(level=logging.ERROR)
    warnings.simplefilter("ignore")
    end, seed = time.monotonic() + options.seconds, options.seed
    while time.monotonic() < end:
        try:
            send_random_messages(seed, 400)
        except Exception:
            traceback.print_exc()
            print(f"studio: failed with seed {seed}")
            raise SystemExit(1) from None
        seed += 1
    print(f"studio: passed, {400 * (seed - options.seed)} messages")


if __name__ == "__main__":
    main()
