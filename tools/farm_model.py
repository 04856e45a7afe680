"""Models the time for many sequences on many nodes from start-up, chunk and frame times, and the
number of nodes beyond which more do not help.
"""

from dataclasses import asdict, dataclass
from math import ceil
from typing import Any

from .farm_throughput import Throughput


@dataclass(frozen=True)
class Model:
    """A worker starts in `startup_s`, then renders a chunk of frames in `frame_s` each. All chunks
    are equal.

    A node runs `workers_a_node` workers. A shared file system receives `bytes_a_frame`, with
    `bytes_a_second` in total. The model does not include waiting in a queue.
    """

    name: str
    startup_s: float
    frame_s: float
    workers_a_node: int
    sequences: int = 10_000
    frames_a_sequence: int = 900
    chunk_s: float = 300.0
    bytes_a_frame: float = 2.5e6
    bytes_a_second: float = 10e9

    @property
    def frames_a_chunk(self) -> int:
        return max(1, min(self.frames_a_sequence, round(self.chunk_s / self.frame_s)))

    @property
    def chunks(self) -> int:
        """Number of chunks.

        A chunk belongs to one sequence, as a worker opens one scene and one run.
        """
        return self.sequences * ceil(self.frames_a_sequence / self.frames_a_chunk)

    @property
    def chunk_seconds(self) -> float:
        """Time of one chunk on one worker, including the worker's start."""
        return self.startup_s + self.frames_a_sequence * self.sequences / self.chunks * self.frame_s

    def seconds(self, nodes: int) -> float:
        """Wall time: the rounds of chunks, or the time of the file system if that is longer."""
        rounds = ceil(self.chunks / (nodes * self.workers_a_node))
        return max(rounds * self.chunk_seconds, self._stored_s)

    @property
    def _stored_s(self) -> float:
        return self.sequences * self.frames_a_sequence * self.bytes_a_frame / self.bytes_a_second

    def efficiency(self, nodes: int) -> float:
        """Share of the nodes' time that is spent on frames."""
        work_s = self.sequences * self.frames_a_sequence * self.frame_s
        return work_s / (self.seconds(nodes) * nodes * self.workers_a_node)

    def stops_scaling(self) -> tuple[int, str]:
        """The number of nodes beyond which more do not help, and why."""
        by_chunks = ceil(self.chunks / self.workers_a_node)
        by_store = int(self.chunks * self.chunk_seconds / (self._stored_s * self.workers_a_node))
        if by_store < by_chunks:
            limit = f"the file system at {self.bytes_a_second / 1e9:g} GB/s is the limit"
            return max(1, by_store), limit
        return by_chunks, "every worker has one chunk"


def of(measured: Throughput, **known: Any) -> Model:
    """The model with this machine, as measured, as a node."""
    return Model(
        name=measured.name,
        startup_s=measured.startup_s,
        frame_s=measured.seconds_a_frame_a_worker,
        workers_a_node=measured.workers,
        **known,
    )


def figures(model: Model, nodes: int) -> dict[str, Any]:
    """The model, and its results for a number of nodes."""
    limit, why = model.stops_scaling()
    return {
        **asdict(model),
        "frames_a_chunk": model.frames_a_chunk,
        "nodes": nodes,
        "hours": round(model.seconds(nodes) / 3600, 3),
        "efficiency": round(model.efficiency(nodes), 3),
        "scales_to_nodes": limit,
        "then": why,
    }
