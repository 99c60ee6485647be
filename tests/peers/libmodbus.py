"""A Modbus server by libmodbus, through ctypes: holding registers 0…199, on loopback TCP or on a serial line."""

from __future__ import annotations

import ctypes
import ctypes.util
import os
import socket
import threading
import tty
from collections.abc import Iterator
from contextlib import contextmanager

REGISTERS = 200
_MAX_ADU = 260


class _Mapping(ctypes.Structure):
    """modbus_mapping_t of modbus.h."""

    _fields_ = (
        *((name, ctypes.c_int) for name in (
            "nb_bits", "start_bits", "nb_input_bits", "start_input_bits",
            "nb_input_registers", "start_input_registers", "nb_registers", "start_registers",
        )),
        ("tab_bits", ctypes.c_void_p),
        ("tab_input_bits", ctypes.c_void_p),
        ("tab_input_registers", ctypes.c_void_p),
        ("tab_registers", ctypes.POINTER(ctypes.c_uint16)),
    )  # fmt: skip


def load() -> ctypes.CDLL | None:
    """libmodbus, or None where it is not installed."""
    name = ctypes.util.find_library("modbus")
    if name is None:
        return None
    library = ctypes.CDLL(name, use_errno=True)
    library.modbus_new_tcp.restype = library.modbus_new_rtu.restype = ctypes.c_void_p
    library.modbus_new_rtu.argtypes = [
        ctypes.c_char_p,
        ctypes.c_int,
        ctypes.c_char,
        ctypes.c_int,
        ctypes.c_int,
    ]
    library.modbus_mapping_new.restype = ctypes.POINTER(_Mapping)
    return library


class LibmodbusServer:
    """Serves until it is closed. `registers` may be looked at and changed at any time."""

    def __init__(self, library: ctypes.CDLL, device: str | None = None, unit: int = 1) -> None:
        self._library = library
        self._mapping = library.modbus_mapping_new(0, 0, REGISTERS, 0)
        self.registers = self._mapping.contents.tab_registers
        self.requests: list[bytes] = []  # as received: from the function code on
        self.port = 0
        self._listening: socket.socket | None = None
        self._ended = threading.Event()
        if device is None:
            self._context = ctypes.c_void_p(library.modbus_new_tcp(b"127.0.0.1", 0))
            self._listening = socket.socket(fileno=library.modbus_tcp_listen(self._context, 1))
            self.port = int(self._listening.getsockname()[1])
        else:
            self._context = ctypes.c_void_p(library.modbus_new_rtu(device.encode(), 115200, b"N", 8, 1))
            library.modbus_set_slave(self._context, unit)
            if library.modbus_connect(self._context) != 0:
                raise OSError(f"{device}: libmodbus cannot open it")
        library.modbus_set_indication_timeout(self._context, 0, 200_000)
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()

    def _serve(self) -> None:
        library, query = self._library, (ctypes.c_uint8 * _MAX_ADU)()
        header = library.modbus_get_header_length(self._context)
        if self._listening is not None:
            accepted = ctypes.c_int(self._listening.fileno())
            library.modbus_tcp_accept(self._context, ctypes.byref(accepted))
        while not self._ended.is_set():
            length = library.modbus_receive(self._context, query)
            if length > 0:
                self.requests.append(bytes(query[header:length]))
                library.modbus_reply(self._context, query, length, self._mapping)

    def close(self) -> None:
        """End within a fifth of a second."""
        self._ended.set()
        if self._listening is not None:
            with socket.socket() as knock:  # whoever still waits for a client gets one
                knock.connect_ex(("127.0.0.1", self.port))
        self._thread.join(2.0)
        self._library.modbus_close(self._context)
        self._library.modbus_mapping_free(self._mapping)
        self._library.modbus_free(self._context)


@contextmanager
def serial_line() -> Iterator[tuple[str, str]]:
    """Two pseudo-terminals whose other ends are tied together."""
    ends = [os.openpty(), os.openpty()]
    masters = [master for master, _ in ends]
    ended = threading.Event()

    def carry(source: int, sink: int) -> None:
        while not ended.is_set():
            try:
                os.write(sink, os.read(source, 4096))
            except OSError:
                return

    for _, slave in ends:
        tty.setraw(slave)
    threads = [
        threading.Thread(target=carry, args=pair, daemon=True) for pair in (masters, list(reversed(masters)))
    ]
    for thread in threads:
        thread.start()
    try:
        yield os.ttyname(ends[0][1]), os.ttyname(ends[1][1])
    finally:
        ended.set()
        for _, slave in ends:
            os.write(slave, b"\0")  # wakes who reads the other end
            os.close(slave)
        for thread in threads:
            thread.join(1.0)
        for master in masters:
            os.close(master)
