"""A CAN bus on a loopback TCP port, in the socketcand protocol (raw mode), for which python-can has a client.

    client: < open bench >  < rawmode >  < send 605 8 40 8 10 0 0 0 0 0 >
    hub:    < hi >  < ok >  < ok >       < frame 585 1700000000.123456 4108100013000000 >

So that a bench and a tool can be two processes on any system. What one sends, all others receive, in one
order. The client's quirks decide some details: it compares whole reads with "< ok >", so nothing may follow
that in the same packet; it takes no separators between messages; it sends with Nagle's algorithm on, so
acknowledgements must not wait.
"""

from __future__ import annotations

import contextlib
import ipaddress
import re
import selectors
import socket
import threading
import time
from dataclasses import dataclass, field
from queue import Empty, SimpleQueue
from typing import Any

import can

from schwung_sim.errors import BenchError

SETTLE_S = 0.2  # after rawmode the client needs time to read "< ok >" on its own
BUFFER_MAX_BYTES = 1 << 20  # a client that falls further behind is disconnected
_COMMAND = re.compile(rb"<\s*([^<>]*?)\s*>")
_QUICK_ACK = getattr(socket, "TCP_QUICKACK", None)


@dataclass(eq=False)
class _Client:
    connection: socket.socket
    incoming: bytes = b""
    outgoing: bytearray = field(default_factory=bytearray)
    opened: bool = False
    raw_since_s: float | None = None
    settled: bool = False


class SocketcandHub:
    """Serves one bus, named `channel`, on host:port; port 0 takes a free one. Raises BenchError."""

    def __init__(self, host: str = "127.0.0.1", port: int = 0, channel: str = "bench") -> None:
        _check_loopback(host)
        self.channel = channel
        self._listener = _listen(host, port)
        self.host, self.port = self._listener.getsockname()[:2]
        self._selector = selectors.DefaultSelector()
        self._selector.register(self._listener, selectors.EVENT_READ)
        self._wake_in, self._wake_out = socket.socketpair()
        self._wake_in.setblocking(False)
        self._selector.register(self._wake_in, selectors.EVENT_READ)
        self._clients: list[_Client] = []
        self._ports: list[HubBus] = []
        self._lock = threading.RLock()
        self._closing = False
        self._thread = threading.Thread(target=self._run, name="socketcand-hub", daemon=True)
        self._thread.start()

    def bus(self, **options: Any) -> HubBus:
        """A bus of this process, attached without a TCP connection in between."""
        port = HubBus(self, **options)
        with self._lock:
            self._ports.append(port)
        return port

    def close(self) -> None:
        """Disconnect all clients and stop serving."""
        self._closing = True
        self._wake()
        self._thread.join(2.0)

    def broadcast(self, message: can.Message, sender: object) -> None:
        """Give a frame to everyone but its sender."""
        identifier = (
            f"{message.arbitration_id:08X}" if message.is_extended_id else f"{message.arbitration_id:03X}"
        )
        text = f"< frame {identifier} {time.time():.6f} {message.data.hex()} >".encode()
        with self._lock:
            for client in [c for c in self._clients if c is not sender and c.raw_since_s is not None]:
                self._put(client, text)
            for port in self._ports:
                if port is not sender:
                    port.incoming.put(message)

    def detach(self, port: HubBus) -> None:
        """A bus of this process leaves."""
        with self._lock, contextlib.suppress(ValueError):
            self._ports.remove(port)

    # -- serving --------------------------------------------------------------------------------

    def _run(self) -> None:
        while not self._closing:
            for chosen, events in self._selector.select(0.05):
                if chosen.fileobj is self._listener:
                    self._accept()
                elif chosen.fileobj is self._wake_in:
                    with contextlib.suppress(BlockingIOError):
                        self._wake_in.recv(4096)
                else:
                    self._serve(chosen.data, events)
            self._look_after_clients()
        with self._lock:
            for client in list(self._clients):
                self._drop(client)
        self._selector.close()
        for end in (self._listener, self._wake_in, self._wake_out):
            end.close()

    def _accept(self) -> None:
        try:
            connection, _ = self._listener.accept()
        except OSError:
            return  # it has gone again
        connection.setblocking(False)
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        client = _Client(connection)
        with self._lock:
            self._clients.append(client)
            self._selector.register(connection, selectors.EVENT_READ, client)
            self._put(client, b"< hi >")

    def _serve(self, client: _Client, events: int) -> None:
        if events & selectors.EVENT_READ:
            try:
                data = client.connection.recv(65536)
                if _QUICK_ACK is not None:
                    client.connection.setsockopt(socket.IPPROTO_TCP, _QUICK_ACK, 1)
            except BlockingIOError:
                return
            except OSError:
                data = b""
            if not data:
                self._drop(client)
                return
            self._parse(client, data)

    def _parse(self, client: _Client, data: bytes) -> None:
        text = client.incoming + data
        end = 0
        for match in _COMMAND.finditer(text):
            end = match.end()
            self._obey(client, match[1].split())
        client.incoming = text[end:][-4096:]

    def _obey(self, client: _Client, words: list[bytes]) -> None:
        command = words[0] if words else b""
        if command == b"send" and client.raw_since_s is not None:
            self._settle(client)
            message = _parse_send(words)
            if message is None:
                self._put(client, b"< error malformed frame >")
            else:
                self.broadcast(message, client)
        elif command == b"open" and len(words) == 2:
            client.opened = words[1] == self.channel.encode()
            self._put(client, b"< ok >" if client.opened else b"< error could not open bus >")
        elif command == b"rawmode" and client.opened:
            with self._lock:  # whoever has read "< ok >" misses nothing from then on
                self._put(client, b"< ok >")
                client.raw_since_s = time.monotonic()
        elif command == b"echo":
            self._put(client, b"< echo >")
        else:
            self._put(client, b"< error unknown command >")

    def _settle(self, client: _Client) -> None:
        """From now on frames go out at once; those that waited go first."""
        with self._lock:
            if not client.settled:
                client.settled = True
                self._flush(client)

    def _put(self, client: _Client, text: bytes) -> None:
        with self._lock:
            client.outgoing += text
            if len(client.outgoing) > BUFFER_MAX_BYTES:
                self._drop(client)
            elif client.settled or client.raw_since_s is None:
                self._flush(client)

    def _flush(self, client: _Client) -> None:
        """Write what the connection takes; the rest is tried again by the hub's own thread."""
        try:
            sent = client.connection.send(client.outgoing) if client.outgoing else 0
            del client.outgoing[:sent]
        except BlockingIOError:
            pass
        except OSError:
            client.outgoing.clear()  # it is gone; its read will say so

    def _look_after_clients(self) -> None:
        with self._lock:
            for client in self._clients:
                waited = client.raw_since_s is not None and time.monotonic() - client.raw_since_s > SETTLE_S
                if waited and not client.settled:
                    self._settle(client)
                elif client.outgoing and (client.settled or client.raw_since_s is None):
                    self._flush(client)

    def _drop(self, client: _Client) -> None:
        with self._lock:
            if client in self._clients:
                self._clients.remove(client)
                with contextlib.suppress(KeyError, ValueError):
                    self._selector.unregister(client.connection)
                client.connection.close()

    def _wake(self) -> None:
        with contextlib.suppress(OSError):
            self._wake_out.send(b"\0")


class HubBus(can.BusABC):
    """The hub's bus for the process that serves it; made by `SocketcandHub.bus`."""

    def __init__(self, hub: SocketcandHub, **options: Any) -> None:
        self.incoming: SimpleQueue[can.Message] = SimpleQueue()
        self._hub = hub
        self.channel_info = f"socketcand hub {hub.host}:{hub.port}"
        super().__init__(channel=hub.channel, **options)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Give a frame to all clients."""
        self._hub.broadcast(msg, self)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        try:
            return self.incoming.get(timeout=timeout), False
        except Empty:
            return None, False

    def shutdown(self) -> None:
        """Leave the hub; the hub itself goes on."""
        super().shutdown()
        self._hub.detach(self)


def _check_loopback(host: str) -> None:
    try:
        loopback = host == "localhost" or ipaddress.ip_address(host).is_loopback
    except ValueError:
        loopback = False
    if not loopback:
        raise BenchError(
            "--tcp", f"{host} is not this machine's loopback", "Use 127.0.0.1: the bus is not guarded."
        )


def _listen(host: str, port: int) -> socket.socket:
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen()
    except (OSError, OverflowError) as error:
        listener.close()
        raise BenchError(
            "--tcp", f"cannot serve {host}:{port} ({error})", "Take another port, or 0 for any."
        ) from error
    return listener


def _parse_send(words: list[bytes]) -> can.Message | None:
    """`send <id> <length> <byte> …`, all hexadecimal; more than three digits make an extended identifier."""
    try:
        identifier, length, *content = (int(word, 16) for word in words[1:])
        data = bytes(content)
    except ValueError:
        return None
    extended = len(words[1]) > 3
    if length != len(data) or length > 8 or identifier >= (1 << 29 if extended else 1 << 11):
        return None
    return can.Message(arbitration_id=identifier, data=data, is_extended_id=extended, timestamp=time.time())
