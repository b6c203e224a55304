"""The panel in the browser: a server that watches a rig over its wires, commands runs, and serves one page.

    the rig ── wires ── watch.py ── envelope.py ── stream.py ── WebSocket ── page/
    astb run ── its door ── runs.py ── server.py ── HTTP ─────────────────┘

`watch` listens as any client may and never becomes the commander. The commander is `astb run`, a separate process that
the panel starts and controls through its door (`astb.live.door`). When the server dies, the run continues.

A view next to the live one is a file in ``page/``, say ``page/faults.js``, and a line in `views.VIEWS`. The file
exports ``show(element, panel)``, which fills an empty element and returns a function that removes it. The server side
of a view is a list of routes in a separate module, say `faults.py`, which the same line names. Routes that change
something use `commands.command`, so that only the one commander may call them.
"""
