"""Proxy between a worker and the server that can cut, delay and stall connections."""

import ctypes
import os
import selectors
import socket
import threading
import time

CHUNK = 16384
MOST_QUEUED = 1 << 20  # maximum number of bytes queued per direction; reading pauses above it


class Pipe:
    """One direction of a connection: bytes that were read, with the time at which they may be written."""

    def __init__(self, source, target):
        self.source, self.target = source, target
        self.queue = []  # (time, bytes)
        self.queued = 0


CLONE_NEWNET = 0x40000000


def family(address):
    """Returns the socket family of an address, which is a path or (host, port)."""
    return socket.AF_UNIX if isinstance(address, str) else socket.AF_INET


class Link(threading.Thread):
    """Forwards connections to `path` to `target`. The fields below may be set from any thread.

    With `space`, the path of a network namespace, its sockets belong to that namespace.
    """

    def __init__(self, path, target, space=None):
        super().__init__(daemon=True)
        self.path, self.target, self.space = path, target, space
        self.held = False  # partition: nothing is transmitted and nothing refused
        self.delay = 0.0  # delay of bytes from the worker, seconds
        self.cut_in = None  # number of bytes from the worker after which the connection is cut
        self.bytes_up = 0  # bytes forwarded to the server
        self.cuts = []  # (bytes of the last read that were forwarded, bytes that were dropped)
        self.held_bytes = 0  # bytes that waited while held
        self.late_bytes = 0  # bytes that were delayed
        self.stopping = False
        self.moved = False  # to another target: connections to the old one are cut
        self.pipes = []
        self.listener = None

    def move(self, target):
        self.target = target
        self.moved = True

    def run(self):
        if self.space:
            with open(self.space, "rb") as space:  # setns() affects only the calling thread
                if ctypes.CDLL(None, use_errno=True).setns(space.fileno(), CLONE_NEWNET) != 0:
                    raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
        self.listener = socket.socket(family(self.path))
        self.listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        self.listener.bind(self.path)
        self.listener.listen(16)
        self.listener.setblocking(False)
        while not self.stopping:
            if self.moved:
                self.moved = False
                for pipe in list(self.pipes):
                    self.close(pipe)
            self.turn()
        for pipe in list(self.pipes):
            self.close(pipe)
        self.listener.close()

    def turn(self):
        with selectors.DefaultSelector() as selector:
            if not self.held:
                selector.register(self.listener, selectors.EVENT_READ)
                now = time.monotonic()
                wanted = {}
                for pipe in self.pipes:
                    if pipe.queued < MOST_QUEUED:
                        wanted[pipe.source] = wanted.get(pipe.source, 0) | selectors.EVENT_READ
                    if pipe.queue and pipe.queue[0][0] <= now:
                        wanted[pipe.target] = wanted.get(pipe.target, 0) | selectors.EVENT_WRITE
                for sock, events in wanted.items():
                    selector.register(sock, events)
            ready = dict((key.fileobj, events) for key, events in selector.select(0.02))
        if self.held:
            return self.count_held()
        if self.listener in ready:
            self.accept()
        for pipe in list(self.pipes):
            if ready.get(pipe.source, 0) & selectors.EVENT_READ:
                self.read(pipe)
            if ready.get(pipe.target, 0) & selectors.EVENT_WRITE:
                self.write(pipe)

    def count_held(self):
        # Bytes in the buffers of the sockets are held up by the partition.
        waiting = 0
        for pipe in self.pipes:
            try:
                waiting += len(pipe.source.recv(1 << 20, socket.MSG_PEEK))
            except OSError:
                pass
        self.held_bytes = max(self.held_bytes, waiting)

    def accept(self):
        try:
            worker, _ = self.listener.accept()
        except OSError:
            return
        server = socket.socket(family(self.target))
        try:
            server.connect(self.target)
        except OSError:
            server.close()
            worker.close()
            return
        for sock in (worker, server):
            sock.setblocking(False)
        up, down = Pipe(worker, server), Pipe(server, worker)
        up.other, down.other = down, up
        up.is_up, down.is_up = True, False
        self.pipes += [up, down]

    def close(self, pipe):
        for one in (pipe, pipe.other):
            if one in self.pipes:
                self.pipes.remove(one)
            one.source.close()

    def read(self, pipe):
        if pipe not in self.pipes:
            return
        try:
            data = pipe.source.recv(CHUNK)
        except BlockingIOError:
            return
        except OSError:
            data = b""
        if not data:
            return self.close(pipe)
        if pipe.is_up and self.cut_in is not None:
            if self.cut_in < len(data):
                passed = self.cut_in
                self.cut_in = None
                try:
                    pipe.target.send(data[:passed])
                except OSError:
                    pass
                self.cuts.append((passed, len(data) - passed))
                return self.close(pipe)
            self.cut_in -= len(data)
        late = self.delay if pipe.is_up else 0
        if late:
            self.late_bytes += len(data)
        pipe.queue.append((time.monotonic() + late, data))
        pipe.queued += len(data)

    def write(self, pipe):
        if pipe not in self.pipes or not pipe.queue:
            return
        due, data = pipe.queue[0]
        try:
            count = pipe.target.send(data)
        except BlockingIOError:
            return
        except OSError:
            return self.close(pipe)
        pipe.queued -= count
        if pipe.is_up:
            self.bytes_up += count
        if count < len(data):
            pipe.queue[0] = (due, data[count:])
        else:
            pipe.queue.pop(0)
