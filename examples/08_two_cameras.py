# SPDX-License-Identifier: Apache-2.0
"""Two cameras, each with a tracker in a thread of its own; one loop prints what both say. Ctrl-C, or the end of both, stops it.

python examples/08_two_cameras.py                      two rendered scenes
python examples/08_two_cameras.py left.mp4 camera:0    your own: files, folders or cameras
"""

import sys
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from itertools import takewhile
from queue import Empty, SimpleQueue
from threading import Event, Thread

import grasptrack as gt
from grasptrack.demo import DemoFrame, demo_scene

Images = Iterable[gt.Frame | DemoFrame]
News = tuple[int, gt.TrackResult | str]  # a camera's number, and a result, or at last why there are no more


def watch(camera: int, connect: Callable[[], Images], news: SimpleQueue[News], stop: Event) -> None:
    """Track one camera's images. Whatever ends it, an error included, who waits for its news is told."""
    why = "failed, see the traceback"
    try:
        tracker = gt.GraspTracker(fingers=2)
        for frame in takewhile(lambda _: not stop.is_set(), connect()):
            news.put((camera, tracker.update(frame.image, time=frame.time)))
        why = "stopped" if stop.is_set() else "ended"
    except gt.GraspTrackError as error:  # this camera is gone; the other goes on
        why = f"failed: {error}"
    finally:
        news.put((camera, why))


def main(cameras: Sequence[Callable[[], Images]]) -> bool:
    """Print each result as it comes until all have ended; whether none failed."""
    news, stop, ends = SimpleQueue[News](), Event(), dict[int, str]()
    for number, connect in enumerate(cameras, start=1):
        Thread(target=watch, args=(number, connect, news, stop), daemon=True).start()
    while len(ends) < len(cameras):
        try:
            camera, told = news.get(timeout=5.0 if stop.is_set() else 0.5)  # some systems keep Ctrl-C waiting as long
            if isinstance(told, str):
                ends[camera] = line = told
            else:
                contacts = "" if told.contacts is None else told.contacts.round(2).tolist()
                line = f"{told.frame:4d}  {told.status:8s}  {contacts} {told.reason}"
            print(f"camera {camera}: {line}", flush=True)
        except KeyboardInterrupt:
            if stop.is_set():
                break  # asked for twice
            stop.set()
        except Empty:
            if stop.is_set():
                break  # a camera that gives no image hears nothing; its thread ends with the program
    return not any(why.startswith("failed") for why in ends.values())


if __name__ == "__main__":
    scenes = [partial(demo_scene, 60), partial(demo_scene, 45, seed=8)]
    sys.exit(not main([partial(gt.open_source, source) for source in sys.argv[1:]] or scenes))
