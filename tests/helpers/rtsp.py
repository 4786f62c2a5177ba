# SPDX-License-Identifier: Apache-2.0
"""A small RTSP server on loopback: H.264 in RTP, interleaved in the one connection, as cameras serve it over TCP."""

import socketserver
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from fractions import Fraction

import av
import cv2

from streaming import RATE, serving, shown

CLOCK = 90000
SDP = (
    "v=0\r\no=- 0 0 IN IP4 127.0.0.1\r\ns=plate\r\nc=IN IP4 0.0.0.0\r\nt=0 0\r\n"
    f"m=video 0 RTP/AVP 96\r\na=rtpmap:96 H264/{CLOCK}\r\na=fmtp:96 packetization-mode=1\r\na=control:track\r\n"
)


@contextmanager
def rtsp_server(port: int) -> Iterator[threading.Event]:
    """Serves rtsp://127.0.0.1:port/ anything; the event, once set, ends every connection."""
    over = threading.Event()

    class Handler(socketserver.StreamRequestHandler):
        def handle(self) -> None:
            while (request := self._request()) is not None:
                method, headers = request
                answer, body = ["RTSP/1.0 200 OK", f"CSeq: {headers.get('cseq', '0')}", "Session: 1"], ""
                if method == "OPTIONS":
                    answer.append("Public: OPTIONS, DESCRIBE, SETUP, PLAY, TEARDOWN")
                elif method == "DESCRIBE":
                    body = SDP
                    answer += ["Content-Type: application/sdp", f"Content-Length: {len(body)}"]
                elif method == "SETUP":
                    answer.append("Transport: RTP/AVP/TCP;unicast;interleaved=0-1")
                self.wfile.write(("\r\n".join(answer) + "\r\n\r\n" + body).encode())
                if method == "PLAY":
                    self._play()
                    return

        def _request(self) -> tuple[str, dict[str, str]] | None:
            lines = []
            while (line := self.rfile.readline().decode().strip()) or not lines:
                if not line:
                    return None
                lines.append(line)
            headers = dict(line.lower().split(": ", 1) for line in lines[1:])
            return lines[0].split()[0], headers

        def _play(self) -> None:
            coder = av.CodecContext.create("libx264", "w")
            coder.width, coder.height, coder.pix_fmt, coder.time_base = 320, 240, "yuv420p", Fraction(1, RATE)
            coder.options = {"preset": "ultrafast", "tune": "zerolatency"}
            coder.gop_size = 10
            step = number = 0
            while not over.is_set():
                frame = av.VideoFrame.from_ndarray(cv2.cvtColor(shown(step), cv2.COLOR_GRAY2BGR), format="bgr24")
                frame.pts = step
                units = [
                    u
                    for packet in coder.encode(frame)
                    for u in bytes(packet).replace(b"\0\0\0\1", b"\0\0\1").split(b"\0\0\1")
                    if u
                ]
                for k, unit in enumerate(units):
                    last = 0x80 if k == len(units) - 1 else 0
                    head = struct.pack(">BBHII", 0x80, last | 96, number & 0xFFFF, step * CLOCK // RATE, 7)
                    self.wfile.write(struct.pack(">cBH", b"$", 0, len(head) + len(unit)) + head + unit)
                    number += 1
                step += 1
                over.wait(1.0 / RATE)

    with serving(port, Handler, over):
        yield over
