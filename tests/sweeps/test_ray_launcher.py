"""What Ray says while it works: kept from the display, wherever it is printed."""

import os
import sys
import threading

from tlr_exp.sweeps.ray_launcher import _quiet


def test_what_rays_threads_and_processes_print_is_kept_in_a_file(tmp_path, capfd):
    log = tmp_path / "launcher" / "ray.log"
    with _quiet(log):
        for name in ("ray_listen_error_messages", "monitor"):
            thread = threading.Thread(target=print, args=(f"by {name}",), name=name)
            thread.start()
            thread.join()
        print("by the sweep")
        os.write(2, b"by a process\n")
    print("afterwards", file=sys.stderr)
    said = capfd.readouterr()
    assert said.out == "by monitor\nby the sweep\n"
    assert said.err == "afterwards\n"
    assert log.read_text() == "by ray_listen_error_messages\nby a process\n"
