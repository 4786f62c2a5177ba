// SPDX-License-Identifier: Apache-2.0
// The kernels of synthesis, bound in a file of their own.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/stl/optional.h>

namespace grasptrack {

void bind_grasp(nanobind::module_ &m);

}  // namespace grasptrack
