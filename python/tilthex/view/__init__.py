"""`tilthex view`: a running, a simulated or a logged flight in the browser (docs/howto/view.md).

viser, an optional dependency, serves the page: `pip install 'tilthex[view]'`.
"""
