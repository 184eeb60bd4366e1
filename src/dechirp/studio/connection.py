"""The connection to a browser, over which what changed together goes as one message."""

from collections.abc import Awaitable
from typing import Any

from bokeh.core.serialization import Ref, Serializer
from bokeh.document.events import DocumentPatchedEvent
from bokeh.document.json import PatchJson
from bokeh.document.models import DocumentModelManager
from bokeh.model import Model
from bokeh.protocol.message import Message
from bokeh.protocol.messages.patch_doc import patch_doc
from bokeh.server.connection import ServerConnection
from bokeh.server.views.ws import WSHandler


class Connection(ServerConnection):
    """As Bokeh's, but that gives each change a message: some forty a frame, each with its parts.

    Changes are awaited once what makes them has returned, so the first that is awaited can take
    all of them along. The page then draws a moment as a whole.
    """

    def __init__(self, protocol: Any, socket: WSHandler, *of: Any) -> None:
        super().__init__(protocol, socket, *of)
        self._browser = socket
        self._changes: list[DocumentPatchedEvent] = []

    def send_patch_document(self, event: DocumentPatchedEvent) -> Awaitable[None]:
        """Send a change with all others that are made before this is awaited."""
        self._changes.append(event)
        return self._send()

    async def _send(self) -> None:
        changes, self._changes = self._changes, []
        changes = [change for change in changes if _is_there(change)]
        if changes:
            await self._browser.send_message(_message(changes))


def _is_there(change: DocumentPatchedEvent) -> bool:
    """Whether the page still has what was changed; else it would go there again, as if new."""
    model = getattr(change, "model", None)
    return model is None or model.document is not None


def _message(changes: list[DocumentPatchedEvent]) -> Message[Any]:
    """As `patch_doc.create` makes it, but with arrays in its text.

    Each array by itself takes two messages more, a hundred a frame: a tenth of all the time that
    server and browser have.
    """
    models = changes[0].document.models
    serializer = _LooksUp(models)
    content = PatchJson(events=serializer.encode(changes))
    models.flush_synced(lambda model: not serializer.has_ref(model))
    return patch_doc(patch_doc.create_header(), {}, content)


class _LooksUp(Serializer):
    """As Bokeh's, but looks a model up when it meets it, not all 1,100 for each message: 3 ms."""

    def __init__(self, models: DocumentModelManager) -> None:
        super().__init__(deferred=False)
        self._models = models
        self._unsent: set[Model] = set()
        models.flush_synced(self._still_unsent)  # it tells of them in no other way

    def get_ref(self, obj: object) -> Ref | None:
        """What the browser knows an object by, if it does."""
        if isinstance(obj, Model) and obj.id in self._models and obj not in self._unsent:
            return obj.ref
        return super().get_ref(obj)

    def _still_unsent(self, model: Model) -> bool:
        self._unsent.add(model)
        return True
