"""A recovery by workers beside one in this process: bits, processor seconds, and what is sent.

    python -m studies.recovery_workers --out out/recovery_workers.json [--side 64] [--steps 60]

36 views of 160², a near lamp each; without errors of places. Workers are processes of this machine.
"""

from __future__ import annotations

import argparse
import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import psutil
from dask import config

import hagoromo as hg
from hagoromo.cluster import connection
from hagoromo.cluster.cluster import workers_of
from studies.cluster_bench import cpu_seconds
from studies.recover_scenes import TrueObject, shots, simulated


def sent() -> float:
    """Bytes that have gone through the loopback of this machine by now [MB]."""
    return psutil.net_io_counters(pernic=True)["lo"].bytes_sent / 1e6


def by_workers(capture: hg.Capture, settings: hg.RecoverySettings, count: int) -> tuple[dict[str, Any], hg.Recovered]:
    """A recovery by `count` workers; those of 0 are this process."""
    if not count:
        begin = time.process_time()
        found = hg.recover(capture, settings)
        return {"workers": 0, "client_cpu_s": time.process_time() - begin, "workers_cpu_s": 0.0}, found
    with workers_of(count) as cluster:
        security = cluster.client.security
        known = {
            f"distributed.comm.tls.{name}": getattr(security, f"tls_{name.replace('.', '_')}")
            for name in ("client.cert", "client.key")
        }
        with config.set(known | {"distributed.comm.tls.ca-file": security.tls_ca_file}):
            before, begin, bytes_before = sum(cpu_seconds(cluster).values()), time.process_time(), sent()
            found = hg.recover(capture, settings, scheduler=cluster.client.scheduler.address)
            row = {
                "workers": count,
                "client_cpu_s": time.process_time() - begin,
                "workers_cpu_s": sum(cpu_seconds(cluster).values()) - before,
                "sent_mb": sent() - bytes_before,
            }
    return row, found


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--side", type=int, default=64, help="nodes along the longest edge")
    parser.add_argument("--steps", type=int, default=60, help="of each level")
    parser.add_argument("--workers", type=int, nargs="*", default=[0, 1, 2])
    given = parser.parse_args()
    capture = simulated(TrueObject(), shots(36, 5, 60, 1), 1).capture
    settings = hg.RecoverySettings(side=given.side, steps=given.steps, keep=0, errors=False)
    rows, first = [], None
    for count in given.workers:
        row, found = by_workers(capture, settings, count)
        first = first or found
        alike = all(np.array_equal(getattr(first, k), getattr(found, k)) for k in ("distance", "colours", "gloss"))
        rows.append({**row, "same_bits": alike})
        print(json.dumps(rows[-1]), flush=True)
    record = {"rows": rows, "side": given.side, "steps": given.steps, "cores": connection.cores()}
    hg.write_json(given.out, record | {"version": hg.__version__})


if __name__ == "__main__":
    main()
