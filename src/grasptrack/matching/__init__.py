# SPDX-License-Identifier: Apache-2.0
"""Two outlines of one flat object matched without a prior: every way in which they fit, and which of them fit alike."""
