#!/usr/bin/env python3
"""A TCP proxy that can abandon its connections and be slow.

Usage: proxy.py PORT [BYTES_PER_SECOND]

Listens on a free port of 127.0.0.1, prints it, and forwards to PORT. On SIGUSR1 it stops forwarding
the connections that exist, without closing them, as a router does that has lost its table; later
connections are forwarded. With a rate, each connection receives at most so many bytes per second
from the server, until SIGUSR2. Prints a line to stderr for each connection.
"""

import signal
import socket
import sys
import threading
import time

generation = 0
abandoned = []  # sockets that stay open
rate = 0  # bytes per second; 0: unlimited


def forward(source, target, born, is_slow):
    """Copies until the end, or until the connection is abandoned."""
    while True:
        try:
            data = source.recv(16384)
            if is_slow and rate > 0:
                time.sleep(len(data) / rate)
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


def accept_connections(listener, port):
    while True:
        client, _ = listener.accept()
        print("connection", file=sys.stderr, flush=True)
        try:
            server = socket.create_connection(("127.0.0.1", port))
        except OSError:
            client.close()
            continue
        for source, target in ((client, server), (server, client)):
            arguments = (source, target, generation, source is server)
            threading.Thread(target=forward, args=arguments, daemon=True).start()


def main():
    global generation, rate
    port = int(sys.argv[1])
    rate = int(sys.argv[2]) if len(sys.argv) > 2 else 0
    # Signals stay blocked and are waited for: a handler would run only once accept() returns if the
    # signal arrives just before the call.
    signals = {signal.SIGUSR1, signal.SIGUSR2}
    signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    listener = socket.create_server(("127.0.0.1", 0))
    threading.Thread(target=accept_connections, args=(listener, port), daemon=True).start()
    print(listener.getsockname()[1], flush=True)
    while True:
        if signal.sigwait(signals) == signal.SIGUSR1:
            generation += 1
        else:
            rate = 0


main()
