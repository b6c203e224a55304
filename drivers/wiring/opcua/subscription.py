"""A subscription that notes when its server last published, and at which intervals the server really samples."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from asyncua import Client

_LIFETIME_COUNT = 10_000


class WatchedSubscription:
    """Calls ``published`` for each notification and each keep-alive, once the handler has received what is new."""

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
        self.period = period  #: s, how often the server publishes where nothing changes, as it says itself

    async def create(self) -> None:
        """Create it on the server."""
        revised = await self._subscription.init()
        self.period = 1e-3 * revised.RevisedPublishingInterval * max(1, revised.RevisedMaxKeepAliveCount)

    async def subscribe_data_change(self, nodes: list[Any], sampling_interval: float) -> Any:
        """Watch the values of ``nodes``, sampled every so many ms; return a handle or an error of each."""
        return await self._subscription.subscribe_data_change(nodes, sampling_interval=sampling_interval)

    async def delete(self) -> None:
        """Delete it on the server."""
        await self._subscription.delete()

    @property
    def sampling(self) -> float:
        """The longest sampling interval (s) among its variables, as the server says itself."""
        return self._session.sampling

    async def _publish(self, publish_result: Any) -> None:
        await self._take(publish_result)
        asyncio.get_running_loop().call_soon(self._published, self)  # behind the handler's own calls


class _Session:
    """A session that notes the revised sampling intervals, which asyncua does not keep."""

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
