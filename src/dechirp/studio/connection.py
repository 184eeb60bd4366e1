"""Connection to a browser that sends simultaneous changes as one message."""

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


class BatchingConnection(ServerConnection):
    """Bokeh connection that batches changes: Bokeh itself sends some forty messages per frame.

    Changes are awaited after the code that makes them has returned, so the first awaited change
    can send all of them. The page then draws a frame as a whole.
    """

    def __init__(self, protocol: Any, socket: WSHandler, *arguments: Any) -> None:
        super().__init__(protocol, socket, *arguments)
        self._browser = socket
        self._changes: list[DocumentPatchedEvent] = []

    def send_patch_document(self, event: DocumentPatchedEvent) -> Awaitable[None]:
        """Send a change with all others that are made before it is awaited."""
        self._changes.append(event)
        return self._send_batch()

    async def _send_batch(self) -> None:
        changes, self._changes = self._changes, []
        changes = [change for change in changes if _is_in_document(change)]
        if changes:
            await self._browser.send_message(_patch_message(changes))


def _is_in_document(change: DocumentPatchedEvent) -> bool:
    """Return True if the changed model is still in the page; else it would be sent again as new."""
    model = getattr(change, "model", None)
    return model is None or model.document is not None


def _patch_message(changes: list[DocumentPatchedEvent]) -> Message[Any]:
    """Build the message of `patch_doc.create`, with arrays in its text.

    A separate array takes two more messages, a hundred per frame: 10 % of the time of server and
    browser.
    """
    models = changes[0].document.models
    serializer = _LazySerializer(models)
    content = PatchJson(events=serializer.encode(changes))
    models.flush_synced(lambda model: not serializer.has_ref(model))
    return patch_doc(patch_doc.create_header(), {}, content)


class _LazySerializer(Serializer):
    """Bokeh serializer with lazy model lookup: looking up all 1,100 models takes 3 ms a message."""

    def __init__(self, models: DocumentModelManager) -> None:
        super().__init__(deferred=False)
        self._models = models
        self._unsent: set[Model] = set()
        models.flush_synced(self._remember_unsent)  # Bokeh offers no other access to them

    def get_ref(self, obj: object) -> Ref | None:
        """Return the reference of an object that the browser has, else None."""
        if isinstance(obj, Model) and obj.id in self._models and obj not in self._unsent:
            return obj.ref
        return super().get_ref(obj)

    def _remember_unsent(self, model: Model) -> bool:
        self._unsent.add(model)
        return True
