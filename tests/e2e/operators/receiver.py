"""receiver.py SECRET_FILE POSTS: receives signed posts on loopback and appends their bodies to a file.

Prints its port. Answers the first three posts with 503, like a busy receiver."""

import hashlib
import hmac
import http.server
import sys

secret = open(sys.argv[1], "rb").read().strip()
posts = open(sys.argv[2], "ab")
left_busy = 3


class Handler(http.server.BaseHTTPRequestHandler):
    protocol_version = "HTTP/1.1"

    def do_POST(self):  # pylint: disable=invalid-name
        global left_busy
        body = self.rfile.read(int(self.headers["Content-Length"]))
        signature = "sha256=" + hmac.new(secret, body, hashlib.sha256).hexdigest()
        if self.headers["Tessera-Signature"] != signature:
            answer = 401
        elif left_busy > 0:
            left_busy -= 1
            answer = 503
        else:
            posts.write(body + b"\n")
            posts.flush()
            answer = 204
        self.send_response(answer)
        self.send_header("Content-Length", "0")
        self.end_headers()


server = http.server.HTTPServer(("127.0.0.1", 0), Handler)
print(server.server_port, flush=True)
server.serve_forever()
