"""Whatever a browser sends, the page says what is wrong with it and lives on."""

from bad_input.studio_page import flood
from nightly import NIGHTLY


def test_a_flood_of_messages_of_all_kinds_leaves_the_page_alive():
    flood(1, 400 if NIGHTLY else 40)
