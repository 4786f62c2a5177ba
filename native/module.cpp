// SPDX-License-Identifier: Apache-2.0
// The compiled kernels. Each folder holds one block of the product and binds itself; what its kernels compute is defined in
// NumPy, in the module of tests/oracle/reference that is named as the folder or its files.

#include <nanobind/nanobind.h>

// What `grasptrack --version` says of this build.
#define GRASPTRACK_TEXT_(x) #x
#define GRASPTRACK_TEXT(x) GRASPTRACK_TEXT_(x)
#if defined(__clang__)
#define GRASPTRACK_COMPILER "Clang " __clang_version__
#elif defined(__GNUC__)
#define GRASPTRACK_COMPILER "GCC " __VERSION__
#elif defined(_MSC_VER)
#define GRASPTRACK_COMPILER "MSVC " GRASPTRACK_TEXT(_MSC_FULL_VER)
#else
#define GRASPTRACK_COMPILER "an unknown compiler"
#endif
#if defined(Py_LIMITED_API)
#define GRASPTRACK_ABI "abi3"
#else
#define GRASPTRACK_ABI "cp" GRASPTRACK_TEXT(PY_MAJOR_VERSION) GRASPTRACK_TEXT(PY_MINOR_VERSION)
#endif

namespace grasptrack {

void bind_geometry(nanobind::module_ &m);
void bind_image(nanobind::module_ &m);
void bind_matching(nanobind::module_ &m);
void bind_transfer(nanobind::module_ &m);
void bind_grasp(nanobind::module_ &m);
void bind_registration(nanobind::module_ &m);

}  // namespace grasptrack

NB_MODULE(_grasptrack_native, m) {
    m.doc() = "The compiled kernels of grasptrack; _grasptrack_native.pyi says what each takes, gives and refuses.";
    m.attr("_build") = GRASPTRACK_ABI ", " GRASPTRACK_COMPILER;
    grasptrack::bind_geometry(m);
    grasptrack::bind_image(m);
    grasptrack::bind_matching(m);
    grasptrack::bind_transfer(m);
    grasptrack::bind_grasp(m);
    grasptrack::bind_registration(m);
}
