import fcntl
import functools
import gc
import importlib.metadata
import itertools
import os
import signal
import socket
import struct
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import pytest
from hypothesis import settings

# A run started in the background inherits an ignored Ctrl-C, and so would every process whose stopping is tested.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

# How long an example takes is the machine's affair: a deadline fails on a busy one.
settings.register_profile("untimed", deadline=None)
settings.load_profile("untimed")


# What is installed stays as it is; every catalogue of effects would read the metadata of all packages anew.
importlib.metadata.entry_points = functools.cache(importlib.metadata.entry_points)


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Nothing of what is collected is garbage: to look for some takes a fifth of the time."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """What takes longest begins first, so that no worker is left with it at the end.

    Files that mostly wait, for nodes or a browser, take turns with files that compute: neither should run alone.
    """
    marks: dict[Path, set[str]] = {}
    for item in items:
        marks.setdefault(item.path, set()).update(mark.name for mark in item.iter_markers())
    waiting = [path for path, names in marks.items() if names & {"ros", "browser"}]
    computing = [path for path, names in marks.items() if "slow" in names and path not in waiting]
    turns = [path for pair in itertools.zip_longest(waiting, computing) for path in pair if path is not None]
    place = {path: number for number, path in enumerate(turns)}
    items.sort(key=lambda item: place.get(item.path, len(place)))


DOMAINS = range(1, 102)
"""Above 101 a DDS domain's ports would be anybody's; 0 is whatever else runs on this host."""


@contextmanager
def own_domain(first: int) -> Iterator[int]:
    """A DDS domain that nobody else on this host has while in here: ``first``, or the next free one."""
    folder = Path(tempfile.gettempdir()) / f"trackway-domains-{os.getuid()}"
    folder.mkdir(exist_ok=True)
    for number in itertools.islice(itertools.cycle(DOMAINS), first % len(DOMAINS), None):
        with (folder / str(number)).open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)  # the end of this process frees it, whatever happens
            except BlockingIOError:
                continue
            yield number
            return


@pytest.fixture(name="own_domain", scope="session")
def _own_domain() -> Callable[[int], AbstractContextManager[int]]:
    return own_domain


@pytest.fixture
def domain(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """A DDS domain of this test's own, set for its processes as well."""
    # Each test begins its search elsewhere: what another has left behind may need a moment to go.
    with own_domain(os.getpid() * 7 + zlib.crc32(request.node.nodeid.encode())) as number:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        yield number


@pytest.fixture(scope="session")
def listening() -> Callable[[int], set[str]]:
    """The addresses at which anybody on this host listens to a TCP port, as `ss -tln` shows them."""

    def addresses(port: int) -> set[str]:
        found = set()
        for table, family in (("tcp", socket.AF_INET), ("tcp6", socket.AF_INET6)):
            for line in Path(f"/proc/net/{table}").read_text().splitlines()[1:]:
                address, number = line.split()[1].split(":")
                if line.split()[3] == "0A" and int(number, 16) == port:
                    # Words of four bytes, each in this machine's order.
                    words = struct.unpack(f"={len(address) // 8}I", bytes.fromhex(address))
                    found.add(socket.inet_ntop(family, struct.pack(f">{len(words)}I", *words)))
        return found

    return addresses


class Beside:
    """A ROS node beside those under test: it awaits events and calls services."""

    def __init__(self, domain: int) -> None:
        # Here and not above: most tests run without ROS.
        import rclpy
        from rclpy.executors import SingleThreadedExecutor

        from sandbot_common.dead_ports import fresh_participant_number

        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=domain)
        with fresh_participant_number(domain):
            self.node = rclpy.create_node("beside", context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)

    def wait(self, condition: Callable[[], Any], seconds: float) -> bool:
        """Whether the condition came to hold in time."""
        end = time.monotonic() + seconds
        while not (holds := bool(condition())) and time.monotonic() < end:
            self._executor.spin_once(timeout_sec=0.02)
        return holds  # not asked once more: what held may have been an event

    def until(self, condition: Callable[[], Any], seconds: float = 60.0) -> None:
        """Wait for the condition to hold; the limit is there to fail, not to measure."""
        assert self.wait(condition, seconds), "waited in vain"

    def call(self, service: str) -> Any:
        """The answer of a Trigger service, which is asked again if it says so, as after a stop."""
        from sandbot_common.standstill import REFUSED_S

        while (answer := self.call_once(service)).message in REFUSED_S:
            self.wait(lambda: False, 0.2)
        return answer

    def call_once(self, service: str) -> Any:
        """Its first answer."""
        from std_srvs.srv import Trigger

        from sandbot_common.ros.service import ask

        client = self.node.create_client(Trigger, service)
        self.until(client.service_is_ready)
        answer = ask(client, Trigger.Request(), self.wait, 60.0)
        self.node.destroy_client(client)
        return answer

    def close(self) -> None:
        """Leave the domain."""
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()


@pytest.fixture(scope="session")
def beside_on() -> Callable[[int], Beside]:
    """Makes ROS nodes in a domain; whoever does so closes them."""
    return Beside


@pytest.fixture
def beside(domain: int) -> Iterator[Beside]:
    """A ROS node in this test's domain."""
    one = Beside(domain)
    yield one
    one.close()


@pytest.fixture(scope="session")
def batch_campaign() -> Callable[..., int]:
    """``campaign --batch`` in this process: each worker process of its own would import and compile anew."""

    def run(*arguments: object) -> int:
        from inline import Inline

        from sandbot_bringup.tools import campaign
        from sandbot_common.parallel import Processes

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(Processes, "executor", lambda _: Inline())
            return campaign.main([*map(str, arguments), "--batch"])

    return run


@pytest.fixture(scope="session")
def slow_cameras(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The project's cameras at 50 Hz: two of them rendered, sent and tracked at 100 Hz fill a core."""
    import yaml

    from sandbot_common.config import config_file
    from sandbot_common.topics import VIEWS

    content = yaml.safe_load(config_file("cameras.yaml").read_text())
    for view in VIEWS:
        content[view]["frame_rate_hz"] = 50.0
    path = tmp_path_factory.mktemp("cameras") / "slow.yaml"
    path.write_text(yaml.safe_dump(content))
    return path


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    """Address of a cluster of two worker processes that know nothing of this one's memory."""
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=":0", host="127.0.0.1") as local:
        yield local.scheduler_address
