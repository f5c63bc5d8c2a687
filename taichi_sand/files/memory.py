"""How much memory there is."""

import sys
from contextlib import suppress
from pathlib import Path

UNKNOWN = 2**40


def available() -> int:
    """Bytes that this process may still take, as far as the system tells: what is free, and what its limits leave."""
    found = [UNKNOWN]
    with suppress(OSError, ValueError):
        lines = dict(line.split(":") for line in Path("/proc/meminfo").read_text().splitlines())
        found.append(1024 * int(lines["MemAvailable"].split()[0]))
    with suppress(OSError, ValueError):
        used = int(Path("/sys/fs/cgroup/memory.current").read_text())
        found.append(int(Path("/sys/fs/cgroup/memory.max").read_text()) - used)
    if sys.platform != "win32":
        import resource

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit != resource.RLIM_INFINITY:
            with suppress(OSError, ValueError):
                found.append(limit - resource.getpagesize() * int(Path("/proc/self/statm").read_text().split()[0]))
    return max(0, min(found))
