"""`python -m evs`, and where the command `evs` begins."""

import signal

# nobody needs to tidy up while modules load: Ctrl-C ends the process, without a traceback
_before = signal.getsignal(signal.SIGINT)
if _before is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from evs.launch.main import main  # noqa: E402 - after the signal

if _before is signal.default_int_handler:
    signal.signal(signal.SIGINT, _before)

if __name__ == "__main__":
    raise SystemExit(main())
