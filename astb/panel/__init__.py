"""The panel in the browser: a server that watches a rig over its wires, commands runs, and serves one page.

    the rig ── wires ── watch.py ── envelope.py ── stream.py ── WebSocket ── page/
    astb run ── its door ── runs.py ── server.py ── HTTP ─────────────────┘

`watch` listens as any client may and never becomes the commander; anyone who commands is `astb run`, its own process,
which the panel starts and talks to through its door (`astb.live.door`). When the server dies, the run goes on.

A view next to the live one is a file in ``page/``, say ``page/faults.js``, and a line in `views.VIEWS`. It exports
``show(element, panel)``, which fills an empty element and returns a function that takes it down again. What it needs
of the server is a list of routes in its own module, say `faults.py`, which the same line names; whatever changes
something goes through `commands.command`, so that only the one commander may do it.
"""
