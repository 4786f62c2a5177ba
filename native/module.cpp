// SPDX-License-Identifier: Apache-2.0
// The compiled kernels. Each folder holds one block of the product and binds itself; what its kernels compute is defined in
// NumPy, in the module of grasptrack/kernels/reference that is named as the folder or its files.

#include <nanobind/nanobind.h>

namespace grasptrack {

void bind_geometry(nanobind::module_ &m);
void bind_image(nanobind::module_ &m);
void bind_matching(nanobind::module_ &m);
void bind_transfer(nanobind::module_ &m);
void bind_grasp(nanobind::module_ &m);
void bind_registration(nanobind::module_ &m);

}  // namespace grasptrack

NB_MODULE(_grasptrack_native, m) {
    m.doc() = "Compiled kernels of grasptrack; grasptrack.kernels.reference defines each of them.";
    grasptrack::bind_geometry(m);
    grasptrack::bind_image(m);
    grasptrack::bind_matching(m);
    grasptrack::bind_transfer(m);
    grasptrack::bind_grasp(m);
    grasptrack::bind_registration(m);
}
