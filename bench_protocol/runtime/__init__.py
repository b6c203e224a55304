"""What a process that holds deadlines needs beside Python: compiled code that sleeps, waits, sends and wakes others.

`binding` says how functions are compiled, `calls` which functions of the system they may call, by way of `library`. On
these stand a `mutex`, an `eventfd`, a `ring` of frames, the `pacing` of a tick and `sending` to a socket.
"""
