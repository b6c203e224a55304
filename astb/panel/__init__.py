"""The panel in the browser: a server that watches a rig over its wires, commands runs, and serves one page.

    the rig ── wires ── watch.py ── envelope.py ── stream.py ── WebSocket ── page/
    astb run ── its door ── runs.py ── server.py ── HTTP ─────────────────┘

`watch` only receives and requests data, and never becomes the commander. The commander is `astb run`, a separate
process that the panel starts and controls through its socket, the door (`astb.live.door`). When the server dies, the
run continues.

A further view is a file in ``page/``, say ``page/faults.js``, and a line in `server.VIEWS`. The file exports
``show(element, panel)``, which fills an empty element and returns a function that removes it. The server side of a view
is a list of routes in a separate module, say `faults.py`, which the same line names. Routes that change something use
`commands.command`, so that only the page with the seat may call them.
"""
