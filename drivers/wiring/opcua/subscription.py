"""A subscription that notes when its server last published, and at which intervals the server really samples."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any

from asyncua import Client, ua
from asyncua.common.subscription import Subscription

_LIFETIME_COUNT = 10_000


class WatchedSubscription(Subscription):  # type: ignore[misc]
    """Calls ``published`` for each notification and each keep-alive, once the handler has received what is new."""

    def __init__(
        self, client: Client, period: float, handler: object, published: Callable[[WatchedSubscription], None]
    ) -> None:
        self._session = _Session(client.uaclient.session)
        self._published = published
        super().__init__(
            self._session,
            ua.CreateSubscriptionParameters(
                RequestedPublishingInterval=1e3 * period,
                RequestedLifetimeCount=_LIFETIME_COUNT,
                RequestedMaxKeepAliveCount=1,
                MaxNotificationsPerPublish=10_000,
                PublishingEnabled=True,
            ),
            handler,
        )
        self.period = period  #: s, how often the server publishes where nothing changes, as it says itself

    async def create(self) -> None:
        """Create it on the server."""
        revised = await self.init()
        self.period = 1e-3 * revised.RevisedPublishingInterval * max(1, revised.RevisedMaxKeepAliveCount)

    @property
    def sampling(self) -> float:
        """The longest sampling interval (s) among its variables, as the server says itself."""
        return self._session.sampling

    async def publish_callback(self, publish_result: Any) -> None:
        """Hand on what the server published."""
        await super().publish_callback(publish_result)
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
