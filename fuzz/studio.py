"""Floods of messages to a page of the studio: it must say what is wrong with them, and live on.

    python fuzz/studio.py --seconds 60

Each flood is of 400 messages, some at once, by chance of its seed. A failure names the seed.
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
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--seed", type=int, default=1)
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
