// SPDX-License-Identifier: Apache-2.0
// The kernels of the evidence for a pose and against it, bound in a file of their own.
#pragma once

#include <nanobind/nanobind.h>

namespace grasptrack {

void bind_evidence(nanobind::module_ &m);

}  // namespace grasptrack
