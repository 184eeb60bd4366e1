"""Random browser messages to a page of the studio."""

from bad_input.studio_page import send_random_messages
from nightly import nightly


@nightly
def test_page_survives_random_browser_messages():
    send_random_messages(1, 400)
