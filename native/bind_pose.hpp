// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nanobind/nanobind.h>

namespace grasptrack {

void bind_pose(nanobind::module_ &m);

}  // namespace grasptrack
