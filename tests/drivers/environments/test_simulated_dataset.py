"""SimulatedDataset: a sample is a function of the arguments, the epoch and its index alone."""

from __future__ import annotations

import gc
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import time
import weakref
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import evs
from evs.drivers.environments import EpisodeSpec
from evs.drivers.gym import LoopEnv, TaskSpec
from evs.drivers.search_path import search_path
from evs.emulator.representations import padded_packet
from evs.msgs import EvsError
from reference.memory import resident_bytes
from reference.worlds_alone import SWING, raw

SMALL = evs.SensorConfig("dvs128", width=24, height=16)
RANGES = {"pos_thres": "uniform(0.1, 0.3)", "readout.scan_us": "choice(100, 200)"}
SCENE = {"geom.*.rgb": "uniform(0.1, 1)", "joint.swing.damping": "uniform(0, 0.2)"}
BOTH = {**RANGES, "scene": SCENE}
SAMPLES = 12


def thrown(random: np.random.Generator, data: Any) -> None:
    """Start anywhere, with a speed at which a few ms have events."""
    data.qpos[0], data.qvel[0] = random.uniform(-1, 1), random.uniform(5, 15)


def swings(**options: Any) -> evs.SimulatedDataset:
    """Samples of 5 ms of an arm that is thrown and driven at random."""
    given = {"cameras": "left", "sensor": SMALL, "ticks": 5, "warm_up": 2, "threads": 2}
    given["start"] = thrown
    return evs.SimulatedDataset(
        mujoco.MjModel.from_xml_string(SWING), samples=SAMPLES, **{**given, **options}
    )


def test_a_spec_stands_for_its_fields() -> None:
    spec = EpisodeSpec(
        mujoco.MjModel.from_xml_string(SWING), "left", sensor=SMALL, ticks=5, start=thrown
    )
    dataset = evs.SimulatedDataset(spec, samples=SAMPLES, warm_up=2, randomise=BOTH)
    assert flat(dataset[3]) == flat(swings(randomise=BOTH)[3])
    # that of an environment has a size
    task = TaskSpec(spec.scene, "left", size=(24, 16), sensor="dvs128", ticks=5, start=thrown)
    assert flat(evs.SimulatedDataset(task, samples=SAMPLES, warm_up=2)[3]) == flat(swings()[3])
    one, other = LoopEnv(task), evs.make_vec(task, 2, ticks=5)
    assert one.action_space == other.single_action_space
    with pytest.raises(EvsError, match="this takes a TaskSpec, not an EpisodeSpec"):
        LoopEnv(spec)


def flat(sample: Any) -> Any:
    """A sample with the bytes of its arrays."""
    if isinstance(sample, dict):
        return {name: flat(value) for name, value in sample.items()}
    if isinstance(sample, list):
        return [flat(one) for one in sample]
    if isinstance(sample, np.ndarray):
        is_events = sample.dtype.names is not None
        return sample.shape, sample.dtype, raw(sample) if is_events else sample.tobytes()
    return sample


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {"randomise": BOTH, "truth": ["depth", "flow", "luminance", "qpos", "qvel", "ctrl"]},
        {"cameras": ("left", "right"), "representation": None, "truth": ["geom_id"]},
        {"representation": "time_surface", "sequence": 2, "sensors": ["angle", "rate"]},
        {"representation": "packet", "start": {"swing": (-1.0, 1.0)}, "warm_up": 60},
        # these are stepped one by one
        {"control": lambda t_s, data: [np.sin(90 * t_s)], "representation": "event_frame"},
    ],
    ids=["randomised", "stereo", "sequence", "start", "function"],
)
def test_a_sample_is_the_same_in_every_batch_and_order(options: dict[str, Any]) -> None:
    found = [flat(one) for one in swings(**options).__getitems__(range(SAMPLES))]
    assert len({str(one) for one in found}) == SAMPLES
    order = np.random.default_rng(1).permutation(SAMPLES)
    for batch in (1, 3, 8):
        again = swings(**options, worlds=5)
        for first in range(0, SAMPLES, batch):
            chosen = order[first : first + batch]
            for index, sample in zip(chosen, again.__getitems__(chosen), strict=True):
                assert flat(sample) == found[index], (batch, index)
    assert flat(again[-1]) == flat(again[np.int64(SAMPLES - 1)]) == found[-1]


def test_a_sample_is_that_of_the_world_of_its_seed() -> None:
    truth = ["luminance", "depth", "flow", "qpos", "qvel", "ctrl"]
    plain = swings(representation=None, truth=truth, sensors=["rate"], seed=3)
    total = 0
    for index in (0, 7, (4, 7)):
        world = evs.World(
            mujoco.MjModel.from_xml_string(SWING), control="random", seed=plain.seed_of(index)
        )
        camera = world.add_camera("left", sensor=SMALL)
        thrown(np.random.Generator(np.random.PCG64(world.seed)), world.data)
        packets = [world.step()[0] for _ in range(7)][2:]
        sample = plain[index]
        assert raw(sample["events"]) == b"".join(raw(one.events) for one in packets)
        total += len(sample["events"])
        seen = camera.ground_truth()
        assert np.array_equal(sample["luminance"], camera.luminance)
        assert np.array_equal(sample["depth"], seen.depth)
        assert np.array_equal(sample["flow"], seen.flow)
        for name in ("qpos", "qvel", "ctrl"):
            assert np.array_equal(sample[name], getattr(world.data, name))
        # of velocity at the end, by a forward pass on a copy
        assert sample["sensors"]["rate"] == world.data.qvel
    assert total > 50


def test_representations_are_those_of_the_functions() -> None:
    size, interval = (24, 16), (2000, 7000)
    expected = {
        "event_frame": lambda e: np.minimum(evs.event_frame(e, size), 255),
        "voxel_grid": lambda e: evs.voxel_grid(e, 3, size, interval),
        "time_surface": lambda e: evs.time_surface(e, size, 9000.0, interval[1]),
        "packet": lambda e: padded_packet(e, 32, interval[1]),
    }
    events = [one["events"] for one in swings(representation=None).__getitems__(range(4))]
    assert min(map(len, events)) > 15
    for kind, function in expected.items():
        dataset = swings(representation=kind, bins=3, tau_us=9000.0, capacity=32)
        for sample, own in zip(dataset.__getitems__(range(4)), events, strict=True):
            assert np.array_equal(sample["events"], function(own)), kind
            assert sample["events"].flags.c_contiguous
            assert sample["events"].flags.writeable


def test_a_sequence_is_cut_from_one_episode() -> None:
    whole = swings(representation=None, ticks=6, truth=["qpos"])
    parts = swings(representation=None, ticks=2, sequence=3, truth=["qpos", "depth"])
    for index in range(4):
        sample, one = parts[index], whole[index]
        assert b"".join(raw(events) for events in sample["events"]) == raw(one["events"])
        assert sample["depth"].shape == (3, 16, 24)
        assert np.array_equal(sample["qpos"][-1], one["qpos"])
    assert parts[0]["qpos"].shape == (3, 1)
    assert swings(sequence=1)[0]["events"].shape == (1, 5, 16, 24)


def test_epochs_and_seeds_differ() -> None:
    dataset = swings(truth=["qpos"])
    names = {
        str(flat(sample))
        for sample in [
            *dataset.__getitems__([0, 1, (1, 0), (2**40, 0)]),
            swings(truth=["qpos"], seed=1)[0],
            swings(truth=["qpos"], seed=-1)[0],
        ]
    }
    assert len(names) == 6
    first = flat(dataset[1, 5])
    dataset.set_epoch(1)
    assert flat(dataset[5]) == first
    seeds = {
        dataset.seed_of((epoch, i), again) for epoch in (0, 9) for i in (0, 9) for again in (0, 9)
    }
    assert len(seeds) == 8


@pytest.mark.integration
@pytest.mark.parametrize("context", ["fork", pytest.param("spawn", marks=pytest.mark.slow)])
def test_processes_give_the_same(context: str) -> None:
    # functions of a test cannot be pickled
    dataset = swings(randomise=RANGES, start={"swing": (-1.0, 1.0)}, ticks=40)
    # the parent's worlds and their threads do not exist in its children
    found = [flat(one) for one in dataset.__getitems__(range(SAMPLES))]
    with multiprocessing.get_context(context).Pool(2) as pool:
        batches = pool.map(
            dataset.__getitems__, [range(first, first + 4) for first in (0, 4, 8)], 1
        )
    assert [flat(one) for batch in batches for one in batch] == found
    assert len(pickle.dumps(dataset)) < 40_000


def forked(dataset: evs.SimulatedDataset) -> tuple[bytes, int]:
    """What a child gives that forked this process and its data set, and how it ended."""
    reads, writes = os.pipe()
    child = os.fork()
    if not child:
        sent = pickle.dumps([flat(one) for one in dataset.__getitems__(range(3))])
        os.write(writes, sent)
        os._exit(0)
    os.close(writes)
    with os.fdopen(reads, "rb") as stream:
        sent = stream.read()
    return sent, os.waitpid(child, 0)[1]


def test_a_fork_leaves_the_worlds_of_its_parent_alone() -> None:
    dataset = swings()
    found = [flat(one) for one in dataset.__getitems__(range(3))]
    sent, status = forked(dataset)
    assert status == 0
    assert pickle.loads(sent) == found
    assert [flat(one) for one in dataset.__getitems__(range(3))] == found


def test_a_sampler_resumes_where_it_was_left() -> None:
    dataset = swings()
    order = dataset.sampler()
    order.set_epoch(2)
    assert len(order) == SAMPLES
    every = [flat(dataset[place]) for place in order]
    resumed = swings()
    order = resumed.sampler()
    order.set_epoch(2, done=5)
    assert len(order) == SAMPLES - 5
    assert [flat(one) for one in resumed.__getitems__(order)] == every[5:]


def test_replicas_share_an_epoch() -> None:
    dataset = swings()
    shares = []
    for rank in range(5):
        order = dataset.sampler(rank=rank, num_replicas=5)
        order.set_epoch(3, done=1)
        assert len(order) == 1
        order.set_epoch(3)
        shares.append([*order])
        assert len(order) == len(shares[-1]) == 2
    assert sorted(place for share in shares for place in share) == [
        (3, number) for number in range(10)
    ]


def explodes(random: np.random.Generator, data: Any) -> None:
    """Start a third of the episodes with a speed that no physics stands."""
    if random.uniform() < 1 / 3:
        data.qvel[0] = 1e13


def test_a_world_that_ends_is_an_error_with_the_sample() -> None:
    dataset = swings(start=explodes)
    begins = [np.random.Generator(np.random.PCG64(dataset.seed_of(i))) for i in range(SAMPLES)]
    ends = [i for i, random in enumerate(begins) if random.uniform() < 1 / 3]
    assert 0 < len(ends) < SAMPLES
    for index in range(SAMPLES):
        if index not in ends:
            assert dataset[index]["events"].shape == (5, 16, 24)
            continue
        expected = rf"the world of sample {index} of epoch 0 ended \(.*\): .*attempts=10"
        with pytest.raises(EvsError, match=expected) as refusal:
            dataset[index]
        assert "\n" not in str(refusal.value)
    with pytest.raises(EvsError, match=f"sample {ends[0]} of epoch 0"):
        dataset.__getitems__(range(SAMPLES))


@pytest.mark.parametrize(
    "options", [{"start": explodes}, {"limits": {"angle": (-0.2, 0.2)}}], ids=["physics", "limits"]
)
def test_a_world_that_ends_is_drawn_again(options: dict[str, Any]) -> None:
    options = {
        "start": {"swing": (-0.5, 0.5)},
        "warm_up": 0,
        "truth": ["qpos"],
        "attempts": 20,
        **options,
    }
    found = swings(**options).__getitems__(range(SAMPLES))
    again = [one["attempt"] for one in found]
    assert min(again) == 0
    assert max(again) > 0
    if "limits" in options:
        assert all(abs(one["qpos"][0]) <= 0.2 for one in found)
    other = swings(**options)
    assert [flat(other[index]) for index in range(SAMPLES)] == [flat(one) for one in found]
    with pytest.raises(EvsError, match=r"ended in each of 2 attempts .*widen limits"):
        swings(limits={"angle": (3.0, 4.0)}, attempts=2)[0]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"samples": 0}, "samples is 0: give 1"),
        ({"samples": 2.5}, "samples is 2.5; give a whole number"),
        ({"ticks": 0}, "ticks is 0: give 1"),
        ({"warm_up": -1}, "warm_up is -1: give 0"),
        ({"sequence": 0}, "sequence is 0: give 1"),
        ({"attempts": 0}, "attempts is 0: give 1"),
        ({"worlds": 0}, "worlds is 0: give 1"),
        ({"threads": -2}, "threads is -2: give 0"),
        ({"truth": "depth"}, r"truth is 'depth': give the names of several, such as \['depth'\]"),
        ({"truth": ["dept"]}, "'dept'.*depth"),
        ({"sensors": ["angel"]}, "angel.*angle"),
        ({"representation": "film"}, "film"),
        ({"bins": 0}, "bins is 0"),
        ({"cameras": ()}, "there is no camera"),
        ({"cameras": "lift"}, "lift.*left"),
        ({"start": {"swong": (0, 1)}}, "swong.*swing"),
        ({"keyframe": "down"}, "down"),
        ({"randomise": {"pos_thresh": "uniform(0.1, 0.3)"}}, "pos_thresh.*pos_thres"),
        ({"control": "sine"}, "sine"),
        ({"limits": {"angel": (0, 1)}}, "angel"),
        ({"model": evs.ModelConfig(chunk=8)}, "model.chunk is 8"),
        ({"seed": "x"}, "seed is 'x'"),
    ],
)
def test_bad_arguments_are_refused_in_a_line(options: dict[str, Any], words: str) -> None:
    with pytest.raises(EvsError, match=words) as refusal:
        evs.SimulatedDataset(
            mujoco.MjModel.from_xml_string(SWING),
            **{"cameras": "left", "sensor": SMALL, "samples": 3, **options},
        )
    assert "\n" not in str(refusal.value)


def test_bad_indices_are_refused() -> None:
    dataset = swings()
    for index in (SAMPLES, -SAMPLES - 1, (1, SAMPLES)):
        with pytest.raises(IndexError, match=f"of {SAMPLES}"):
            dataset[index]
    with pytest.raises(EvsError, match="give a number, or"):
        dataset[1, 2, 3]  # type: ignore[index]
    with pytest.raises(EvsError, match="epoch is -1"):
        dataset.set_epoch(-1)
    with pytest.raises(EvsError, match=r"rank is 2: give 0 \.\.\. 1"):
        dataset.sampler(rank=2, num_replicas=2)
    with pytest.raises(EvsError, match="13 num_replicas share 12 samples"):
        dataset.sampler(num_replicas=13)
    with pytest.raises(EvsError, match="done is 13, but an epoch has 12"):
        dataset.sampler().set_epoch(0, 13)
    assert dataset.__getitems__([]) == []
    # the loop of a list ends
    assert len([*swings(ticks=1, warm_up=0)]) == SAMPLES


def test_a_batch_that_was_interrupted_leaves_nothing_behind() -> None:
    calls = 0

    def control(t_s: float, data: Any) -> list[float]:
        nonlocal calls
        calls += 1
        if calls == 9:
            raise KeyboardInterrupt
        return [0.3]

    dataset = swings(control=control)
    with pytest.raises(KeyboardInterrupt):
        dataset.__getitems__(range(3))
    found = [flat(one) for one in dataset.__getitems__(range(3))]
    assert found == [flat(one) for one in swings(control=control).__getitems__(range(3))]


def test_a_data_set_is_gone_with_its_last_name() -> None:
    threads = len([*Path("/proc/self/task").iterdir()])
    gc.collect()
    gc.disable()
    try:
        dataset = swings(truth=["depth"])
        dataset.__getitems__(range(4))
        worlds = weakref.ref(dataset._worlds)
        del dataset
        assert worlds() is None
        assert gc.collect() == 0
    finally:
        gc.enable()
    assert len([*Path("/proc/self/task").iterdir()]) <= threads


PROGRAM = """
import os
import sys
from multiprocessing import get_context
import evs
dataset = evs.SimulatedDataset(
    sys.argv[1], "left", samples=10**9, sensor=evs.SensorConfig("dvs128", width=24, height=16)
)

def simulate():
    for first in range(0, len(dataset), 4):
        # in one piece: workers write at once
        os.write(1, b"%d\\n" % len(dataset.__getitems__(range(first, first + 4))))

if sys.argv[2] == "here":
    simulate()
# each simulates when the parent has: their worlds are their own
dataset.__getitems__(range(4))
workers = [get_context("fork").Process(target=simulate) for _ in range(2)]
for worker in workers:
    worker.start()
for worker in workers:
    worker.join()
"""


@pytest.mark.integration
@pytest.mark.parametrize("where", ["here", "workers"])
def test_ctrl_c_ends_it_and_its_workers(where: str, tmp_path: Path) -> None:
    (tmp_path / "swing.xml").write_text(SWING)
    (tmp_path / "program.py").write_text(PROGRAM)
    program = subprocess.Popen(
        [sys.executable, tmp_path / "program.py", tmp_path / "swing.xml", where],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        env={**os.environ, "PYTHONPATH": search_path()},
    )
    assert program.stdout is not None
    assert program.stdout.readline() == "4\n"
    os.killpg(program.pid, signal.SIGINT)
    _, err = program.communicate(timeout=60)
    assert program.returncode in (1, -signal.SIGINT)
    assert "KeyboardInterrupt" in err
    until_s = time.monotonic() + 30
    while True:
        try:
            os.killpg(program.pid, 0)
        except ProcessLookupError:
            break
        assert time.monotonic() < until_s, "a worker is left"
        time.sleep(0.05)


BATCHES, BATCH = 20, 4
MOST_BYTES = 2000
"""in each sample: less than the smallest image of it, 24 x 16 float32, with its header"""


def grown(is_kept: bool) -> float:
    """Bytes that every sample adds, in the one of four windows where it is least."""
    dataset = swings(representation=None, truth=["depth", "qpos"], randomise=BOTH)
    kept = []
    sizes = []
    for _ in range(7):
        for number in range(BATCHES):
            dataset.set_epoch(number)
            found = dataset.__getitems__(range(BATCH))
            if is_kept:
                kept.extend(one["depth"] + number for one in found for _ in range(8))
        sizes.append(resident_bytes())
    # the first two fill what the set-up has freed
    return float(np.diff(sizes[2:]).min()) / (BATCHES * BATCH)


@pytest.mark.slow
@pytest.mark.parametrize("case", ["dropped", "kept"])
def test_batches_leave_no_memory_behind(case: str) -> None:
    done = subprocess.run(
        [sys.executable, __file__, case],
        env={**os.environ, "PYTHONPATH": search_path()},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    # what is kept is found
    assert (float(done.stdout) > MOST_BYTES) == (case == "kept")


if __name__ == "__main__":
    print(grown(sys.argv[1] == "kept"))
