"""`tilthex view`: a flight in the browser, as it flies, from its log, or simulated (docs/howto/view.md).

The page is served by viser, an optional dependency: `pip install 'tilthex[view]'`.
"""
