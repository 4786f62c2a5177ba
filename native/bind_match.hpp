// SPDX-License-Identifier: Apache-2.0
// The kernels that match two outlines without a prior.
#pragma once

#include <nanobind/nanobind.h>

namespace grasptrack {

void bind_match(nanobind::module_ &m);

}  // namespace grasptrack
