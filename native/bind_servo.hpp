// SPDX-License-Identifier: Apache-2.0
// The kernels of the servo.
#pragma once

#include <nanobind/nanobind.h>

namespace grasptrack {

void bind_servo(nanobind::module_ &m);

}  // namespace grasptrack
