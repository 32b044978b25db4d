#!/usr/bin/env python3
"""A TCP proxy that can abandon its connections.

Usage: proxy.py PORT

Listens on a free port of 127.0.0.1, prints it, and forwards to PORT. On SIGUSR1 it stops to forward
the connections that exist, without closing them, as a router does that has lost its table; later
connections are forwarded.
"""

import signal
import socket
import sys
import threading

generation = 0
abandoned = []  # sockets that stay open


def forward(source, target, born):
    """Copies until the end, or until the connection is abandoned."""
    while True:
        try:
            data = source.recv(65536)
            if generation != born:
                abandoned.extend([source, target])
                return
            if not data:
                target.shutdown(socket.SHUT_WR)
                return
            target.sendall(data)
        except OSError:
            for end in (source, target):
                try:
                    end.shutdown(socket.SHUT_RDWR)
                except OSError:
                    pass
            return


def abandon(_signal, _frame):
    global generation
    generation += 1


def main():
    port = int(sys.argv[1])
    signal.signal(signal.SIGUSR1, abandon)
    listener = socket.create_server(("127.0.0.1", 0))
    print(listener.getsockname()[1], flush=True)
    while True:
        client, _ = listener.accept()
        try:
            server = socket.create_connection(("127.0.0.1", port))
        except OSError:
            client.close()
            continue
        for source, target in ((client, server), (server, client)):
            threading.Thread(target=forward, args=(source, target, generation), daemon=True).start()


main()
