"""The most memory that a program of its own has taken."""

PEAK = """
import re, sys
def peak_kib():
    # ru_maxrss is that of the process that started this one, where it is larger
    return int(re.search(r"VmHWM:\\s+(\\d+) kB", open("/proc/self/status").read())[1])
"""
"""Python text that defines peak_kib(); for `python -c`."""
