"""The pictures of docs/gallery.md, and the page itself: python -m astb_studies.gallery."""
