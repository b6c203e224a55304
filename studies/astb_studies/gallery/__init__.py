"""The pictures of docs/gallery.md, and the page itself: python -m tools.gallery."""
