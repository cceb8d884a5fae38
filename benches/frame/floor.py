"""Wall seconds that the OpenEXR library takes to decode a stack and to encode a picture with ZIP, on one thread.

`python3 floor.py STACK PICTURE OUTPUT` prints both. It needs the package `OpenEXR`, which is the C++ library.
"""

import sys
import time

import OpenEXR

# Versions before 3.4 cannot set this; they start no threads by themselves.
if hasattr(OpenEXR, "set_global_thread_count"):
    OpenEXR.set_global_thread_count(0)

stack, picture, output = sys.argv[1:]

start = time.perf_counter()
for part in OpenEXR.File(stack).parts:
    part.channels
decode_seconds = time.perf_counter() - start

source = OpenEXR.File(picture)
header = {**source.header(), "compression": OpenEXR.ZIP_COMPRESSION}
channels = source.channels()
start = time.perf_counter()
OpenEXR.File(header, channels).write(output)
encode_seconds = time.perf_counter() - start

print(decode_seconds, encode_seconds)
