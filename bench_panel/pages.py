"""The WebSockets of the pages, as uvicorn serves them: one that sends no UTF-8 is closed, without a traceback."""

from uvicorn.protocols.websockets.websockets_sansio_impl import WebSocketsSansIOProtocol
from websockets.frames import CloseCode


class Pages(WebSocketsSansIOProtocol):
    """uvicorn's own protocol, but for text that is none: it is closed with 1007, and nobody's terminal is filled."""

    def send_receive_event_to_app(self) -> None:
        if self.curr_msg_data_type == "text" and not self.close_sent:
            try:
                b"".join(self.frames).decode()
            except UnicodeDecodeError:
                self.frames = []
                self.conn.fail(CloseCode.INVALID_DATA, "not UTF-8")  # whether or not it is closing already
                self.transport.write(b"".join(self.conn.data_to_send()))
                self.queue.put_nowait({"type": "websocket.disconnect", "code": int(CloseCode.INVALID_DATA)})
                self.close_sent = True
                self.transport.close()
                return
        super().send_receive_event_to_app()
