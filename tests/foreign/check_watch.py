#!/usr/bin/env python3
"""Connects to `formica watch` as Foxglove does, and looks at what it sends.

Usage: check_watch.py [URL]      (pip install websockets mcap-protobuf-support)
Exit code: 0 all fine, 1 something is wrong.
"""

import asyncio
import base64
import json
import struct
import sys
from collections import Counter

from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message_factory import GetMessageClass
from websockets.asyncio.client import connect

SECONDS = 4.0


def message_class(channel):
    pool = DescriptorPool()
    for file in FileDescriptorSet.FromString(base64.b64decode(channel["schema"])).file:
        pool.Add(file)
    return GetMessageClass(pool.FindMessageTypeByName(channel["schemaName"]))


async def check(url):
    async with connect(url, subprotocols=["foxglove.sdk.v1"], max_size=None) as socket:
        channels, counts, steps = {}, Counter(), []
        end = asyncio.get_running_loop().time() + SECONDS
        while (left := end - asyncio.get_running_loop().time()) > 0:
            try:
                data = await asyncio.wait_for(socket.recv(), left)
            except asyncio.TimeoutError:
                break
            if isinstance(data, str):
                text = json.loads(data)
                if text["op"] == "serverInfo":
                    print("server:", text["name"])
                elif text["op"] == "advertise":
                    for channel in text["channels"]:
                        channels[channel["id"]] = (channel, message_class(channel))
                    wanted = [{"id": id, "channelId": id} for id in channels]
                    await socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
                continue
            if data[0] != 1:
                continue
            id, _ = struct.unpack_from("<IQ", data, 1)
            channel, kind = channels[id]
            decoded = kind.FromString(data[13:])
            counts[channel["topic"]] += 1
            if channel["topic"] == "/step":
                steps.append(decoded.step)
    for topic, count in sorted(counts.items()):
        print(f"  {topic:16} {count}")
    assert len(channels) == 18, f"{len(channels)} topics"
    assert counts["/tf"] >= 5, "the ant does not move"
    for topic in ("/scene/maze", "/graph", "/goal"):
        assert counts[topic] >= 2, f"{topic} is not told again to those who come late"
    # Ten a second, as simulated; a trace that ends begins anew.
    assert len(steps) <= 12 * SECONDS, f"{len(steps)} steps in {SECONDS} s"
    assert all(b == a + 1 or b == 0 for a, b in zip(steps, steps[1:])), steps


if __name__ == "__main__":
    asyncio.run(check(sys.argv[1] if len(sys.argv) > 1 else "ws://127.0.0.1:8765"))
