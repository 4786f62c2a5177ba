// SPDX-License-Identifier: Apache-2.0
// NumPy arrays in and out.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <type_traits>

#include "geometry.hpp"

namespace grasptrack {

namespace nb = nanobind;

using PointArray = nb::ndarray<const double, nb::shape<-1, 2>, nb::c_contig, nb::device::cpu>;
using RowArray = nb::ndarray<const double, nb::shape<-1, -1>, nb::c_contig, nb::device::cpu>;
using ValueArray = nb::ndarray<const double, nb::shape<-1>, nb::c_contig, nb::device::cpu>;
using IndexArray = nb::ndarray<const std::int64_t, nb::shape<-1>, nb::c_contig, nb::device::cpu>;

inline const Vec *vectors(const PointArray &array) {
    static_assert(sizeof(Vec) == 2 * sizeof(double));
    return reinterpret_cast<const Vec *>(array.data());
}

inline Points points_of(const PointArray &array) { return {vectors(array), array.shape(0)}; }

inline Points contour_of(const PointArray &array) {
    if (array.shape(0) == 0) throw std::invalid_argument("a contour needs points");
    return points_of(array);
}

inline Outline outline_of(const PointArray &points, const IndexArray &offsets) {
    const std::int64_t *o = offsets.data();
    const std::size_t entries = offsets.shape(0);
    bool good = entries >= 2 && points.shape(0) > 0 && o[0] == 0 &&
                o[entries - 1] == static_cast<std::int64_t>(points.shape(0));
    for (std::size_t c = 1; good && c < entries; ++c) good = o[c - 1] < o[c];
    if (!good) throw std::invalid_argument("offsets must rise from 0 to the number of points");
    return {points_of(points), o, entries - 1};
}

inline Place place_of(const Outline &outline, const RowArray &places, std::size_t row) {
    const double *where = places.data() + row * places.shape(1);
    return find_place(outline, where[0], where[1]);
}

inline std::size_t count_places(const RowArray &places) {
    if (places.shape(1) < 2) throw std::invalid_argument("a place is a contour and a position");
    return places.shape(0);
}

// A new array, made by NumPy itself, which costs less than handing memory over through a capsule.
template <typename Value> class OutputOf {
  public:
    explicit OutputOf(std::size_t size) { make(PyLong_FromSize_t(size)); }
    OutputOf(std::size_t rows, std::size_t columns) {
        make(Py_BuildValue("(nn)", static_cast<Py_ssize_t>(rows), static_cast<Py_ssize_t>(columns)));
    }

    Value *values() { return data_; }
    Vec *vectors() { return reinterpret_cast<Vec *>(data_); }
    nb::object array() { return std::move(array_); }

  private:
    static_assert(std::is_same_v<Value, double> || std::is_same_v<Value, std::int64_t>);

    void make(PyObject *owned_shape) {
        // Kept for the life of the process, as NumPy itself is.
        static PyObject *const empty = nb::object(nb::module_::import_("numpy").attr("empty")).release().ptr();
        static PyObject *const type =
            nb::object(nb::module_::import_("numpy").attr(std::is_same_v<Value, double> ? "float64" : "int64")).release().ptr();
        nb::object shape = nb::steal(owned_shape);
        PyObject *arguments[] = {nullptr, shape.ptr(), type};
        array_ = nb::steal(PyObject_Vectorcall(empty, arguments + 1, 2 | PY_VECTORCALL_ARGUMENTS_OFFSET, nullptr));
        if (!array_.is_valid()) nb::raise_python_error();
        Py_buffer buffer;
        if (PyObject_GetBuffer(array_.ptr(), &buffer, PyBUF_WRITABLE) != 0) nb::raise_python_error();
        data_ = static_cast<Value *>(buffer.buf);
        PyBuffer_Release(&buffer);
    }

    nb::object array_;
    Value *data_ = nullptr;
};

using Output = OutputOf<double>;

}  // namespace grasptrack
