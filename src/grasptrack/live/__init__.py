# SPDX-License-Identifier: Apache-2.0
"""The live page: a tracker in a thread of its own, what people tell it, and a server that shows it in a browser.

`session` and what it is made of know nothing of the web; `server`, `guard`, `frames` and the files in `page` are the page.
What people ask for and cannot have, and what cannot be bound or written, is an `InputError`.
"""
