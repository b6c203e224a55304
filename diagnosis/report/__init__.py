"""A finding as a page that people read: pictures first, numbers together with them."""
