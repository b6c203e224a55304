"""Values that an OPC UA server publishes, and detection of a server that has stopped publishing."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING, Any, Final

from bench_protocol.units import NS
from drivers.errors import MapMismatch, Refused
from drivers.wiring.contract import Remark

if TYPE_CHECKING:
    from asyncua import Client, ua
import asyncio
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from asyncua import Client

#: Number of missing notifications or keep-alives after which a subscription counts as dropped.
_MISSING_MAX: Final = 3


class Reports:
    """The values of a subscription, each with the time at which the server sent or confirmed it.

    ``names`` are the points by node, ``number`` decodes a value. Changes arrive in the thread of the event loop; all
    other methods are called by one thread.
    """

    def __init__(
        self,
        where: str,
        names: Mapping[ua.NodeId, Sequence[str]],
        every: float,
        stale: float,
        now: Callable[[], int],
        number: Callable[[str, ua.DataValue], float],
    ) -> None:
        self._where, self._names, self._every, self._stale = where, names, every, stale
        self._now, self._number = now, number
        self._lock = threading.Lock()
        self._news: list[tuple[int, str, float]] = []
        self._known: dict[str, float] = {}
        self._published = self._confirmed = (
            now()
        )  # ns, of the last notification, and of the last one handed on
        self._subscription: WatchedSubscription | None = None
        self._ended = False  # by its status message
        self._drops, self._missing = (
            0,
            0.0,
        )  # subscriptions that the server dropped; s without one, altogether

    async def begin(self, client: Client) -> None:
        """Subscribe. Raises Refused if the server does not report a point, MapMismatch if it does so too rarely."""
        subscription = WatchedSubscription(client, self._every, self, self._publish)
        await subscription.create()
        try:
            await self._fill(subscription, client)
        except BaseException:
            await _delete(subscription)
            raise
        self._subscription, self._ended = subscription, False
        self._publish(subscription)

    async def _fill(self, subscription: WatchedSubscription, client: Client) -> None:
        nodes = [client.get_node(node) for node in self._names]
        results = await subscription.subscribe_data_change(nodes, sampling_interval=1e3 * self._every)
        refused = [
            f"{', '.join(several)} ({one.name})"
            for several, one in zip(self._names.values(), results, strict=True)
            if not isinstance(one, int)
        ]
        if refused:
            raise Refused(
                f"{self._where} refuses to report {', '.join(refused)} by itself; to read on request, "
                "set subscribe = false",
                0,
            )
        slowest = max(subscription.period, subscription.sampling)
        if slowest > self._stale:
            raise MapMismatch(
                f"{self._where} confirms its values every {slowest:g} s at best, but they are stale after "
                f'{self._stale:g} s; set stale = "{_MISSING_MAX * slowest:g} s"'
            )

    @property
    def period(self) -> float:
        """Interval (s) at which the server confirms values, by its own revised intervals."""
        one = self._subscription
        return self._every if one is None else max(self._every, one.period, one.sampling)

    def drain(self) -> list[tuple[int, dict[str, float]]]:
        """Return times (ns) and values since the last call, in order; unchanged values have the time of their
        confirmation.
        """
        with self._lock:
            news, self._news = self._news, []
            published = self._published
        found = [(time, {name: value}) for time, name, value in news]
        self._known.update({name: value for _, name, value in news})
        if published > self._confirmed:
            self._confirmed = published
            rest = self._known.keys() - {name for _, name, _ in news}
            found.append((published, {name: self._known[name] for name in rest}))
        return found

    @property
    def allowed(self) -> float:
        """Silence (s) after which a subscription counts as dropped."""
        return max(self._stale, _MISSING_MAX * self.period)

    @property
    def silence(self) -> float:
        """Time (s) since the server last published."""
        return (self._now() - self._published) / NS

    @property
    def dropped(self) -> bool:
        """Whether the server has ended the subscription, by its own report or after too long a silence."""
        return self._ended or self.silence > self.allowed

    async def renew(self, client: Client) -> None:
        """Subscribe again after a subscription was dropped."""
        silence = self.silence
        if self._subscription is not None:  # the server may still know it
            await _delete(self._subscription)
        with self._lock:
            self._known.clear()
            self._news.clear()
        await self.begin(client)
        self._drops, self._missing = self._drops + 1, self._missing + silence

    def remarks(self) -> list[Remark]:
        """Return remarks on unexpected behaviour of the server, each with whether data are lost."""
        found = []
        if self._drops:
            text = f"the server dropped the subscription {self._drops} times; no values came for {self._missing:.2g} s"
            found.append(Remark(text, True))
        if self.period > self._every:
            text = f"the server confirms its values every {self.period:g} s, less often than every = {self._every:g} s"
            found.append(Remark(text, False))
        return found

    # -- what asyncua calls ---------------------------------------------------------------------------------------

    def datachange_notification(self, node: Any, value: Any, data: Any) -> None:
        """Store the new value of a node, with its status."""
        del value
        with self._lock:
            for name in self._names[node.nodeid]:
                self._news.append((self._now(), name, self._number(name, data.monitored_item.Value)))

    def status_change_notification(self, change: Any) -> None:
        """Record that the server has ended the subscription, according to its report."""
        self._ended = not change.Status.is_good()

    def _publish(self, subscription: WatchedSubscription) -> None:
        if subscription is self._subscription:
            with self._lock:
                self._published = self._now()


async def _delete(subscription: WatchedSubscription) -> None:
    """Delete a subscription, if the server knows it."""
    with contextlib.suppress(Exception):
        await subscription.delete()


_LIFETIME_COUNT = 10_000


class WatchedSubscription:
    """A subscription that calls ``published`` for each notification and keep-alive, after the handler has the new
    values.
    """

    def __init__(
        self, client: Client, period: float, handler: object, published: Callable[[WatchedSubscription], None]
    ) -> None:
        import asyncua  # an extra

        self._session = _Session(client.uaclient.session)
        self._published = published
        self._subscription = asyncua.common.subscription.Subscription(
            self._session,
            asyncua.ua.CreateSubscriptionParameters(
                RequestedPublishingInterval=1e3 * period,
                RequestedLifetimeCount=_LIFETIME_COUNT,
                RequestedMaxKeepAliveCount=1,
                MaxNotificationsPerPublish=10_000,
                PublishingEnabled=True,
            ),
            handler,
        )
        self._take = self._subscription.publish_callback
        self._subscription.publish_callback = self._publish
        self.period = period  #: s, interval of publications without changes, as revised by the server

    async def create(self) -> None:
        """Create the subscription on the server."""
        revised = await self._subscription.init()
        self.period = 1e-3 * revised.RevisedPublishingInterval * max(1, revised.RevisedMaxKeepAliveCount)

    async def subscribe_data_change(self, nodes: list[Any], sampling_interval: float) -> Any:
        """Monitor the values of ``nodes``, sampled every ``sampling_interval`` ms; return a handle or an error for
        each.
        """
        return await self._subscription.subscribe_data_change(nodes, sampling_interval=sampling_interval)

    async def delete(self) -> None:
        """Delete the subscription on the server."""
        await self._subscription.delete()

    @property
    def sampling(self) -> float:
        """The longest sampling interval (s) of its variables, as revised by the server."""
        return self._session.sampling

    async def _publish(self, publish_result: Any) -> None:
        await self._take(publish_result)
        asyncio.get_running_loop().call_soon(self._published, self)  # behind the handler's own calls


class _Session:
    """A session that stores the revised sampling intervals, which asyncua does not keep."""

    def __init__(self, session: Any) -> None:
        self._session = session
        self.sampling = 0.0

    def __getattr__(self, name: str) -> Any:
        return getattr(self._session, name)

    async def create_monitored_items(self, params: Any) -> Any:
        results = await self._session.create_monitored_items(params)
        intervals = [one.RevisedSamplingInterval for one in results if one.StatusCode.is_good()]
        self.sampling = max([self.sampling, *(1e-3 * interval for interval in intervals)])
        return results
