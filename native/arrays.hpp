// SPDX-License-Identifier: Apache-2.0
// NumPy arrays and named tuples, in and out.
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>
#include <nanobind/stl/optional.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <initializer_list>
#include <limits>
#include <optional>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>
#include <vector>

#include "geometry/points.hpp"
#include "wide.hpp"

namespace nb = nanobind;
using namespace nb::literals;

namespace grasptrack {

template <typename Value, typename... Shape> using Input = nb::ndarray<const Value, Shape..., nb::c_contig, nb::device::cpu>;
using PointArray = Input<double, nb::shape<-1, 2>>;
using RowArray = Input<double, nb::ndim<2>>;
using MatrixArray = Input<double, nb::shape<3, 3>>;
using ValueArray = Input<double, nb::ndim<1>>;
using IndexArray = Input<std::int64_t, nb::ndim<1>>;
using FlagArray = Input<bool, nb::ndim<1>>;
using ByteImage = Input<std::uint8_t, nb::ndim<2>>;

inline const Vec *vectors(const PointArray &array) {
    static_assert(sizeof(Vec) == 2 * sizeof(double));
    return reinterpret_cast<const Vec *>(array.data());
}

inline Points points_of(const PointArray &array) { return {vectors(array), array.shape(0)}; }

// What comes from Python is checked here, once: behind it every size and index is one that an array has. Of coordinates so
// large the third moments' powers stay finite.
constexpr double farthest = 1e12;

GRASPTRACK_WIDE inline bool all_within(const double *values, std::size_t count, double most) {
    bool good = true;  // without a way out, so that several are looked at at a time
    for (std::size_t i = 0; i < count; ++i) good &= std::fabs(values[i]) <= most;  // a NaN is not
    return good;
}

inline void check_within(double value, double low, double high, const char *name) {
    if (!(value >= low && value <= high))
        throw std::invalid_argument(std::string(name) + " must be from " + number(low) + " to " + number(high) + ", not " + number(value));
}

inline void check_size(std::size_t size, std::size_t most, const char *what) {
    if (size > most) throw std::invalid_argument("at most " + std::to_string(most) + " " + what + ", not " + std::to_string(size));
}

inline void check_finite(const ValueArray &array, const char *name) {
    if (!all_within(array.data(), array.shape(0), std::numeric_limits<double>::max()))
        throw std::invalid_argument(std::string(name) + " must be finite");
}

inline void check_coordinates(const PointArray &array) {
    if (!all_within(array.data(), 2 * array.shape(0), farthest))
        throw std::invalid_argument("a contour's coordinates must be finite, and at most 1e12");
}

inline Points contour_of(const PointArray &array) {
    if (array.shape(0) == 0) throw std::invalid_argument("a contour needs points");
    check_coordinates(array);
    return points_of(array);
}

inline Outline outline_of(const PointArray &points, const IndexArray &offsets) {
    const std::int64_t *o = offsets.data();
    const std::size_t entries = offsets.shape(0);
    bool good = entries >= 2 && points.shape(0) > 0 && o[0] == 0 &&
                o[entries - 1] == static_cast<std::int64_t>(points.shape(0));
    for (std::size_t c = 1; good && c < entries; ++c) good = o[c - 1] < o[c];
    if (!good) throw std::invalid_argument("offsets must rise from 0 to the number of points");
    check_coordinates(points);
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

inline void check_arc(std::size_t points, const ValueArray &arc) {
    if (points < 1 || arc.shape(0) != points + 1)
        throw std::invalid_argument("arc needs one entry more than the contour has points");
    const double *s = arc.data();
    bool good = s[0] == 0 && s[points] > 0 && s[points] <= farthest * static_cast<double>(points);
    for (std::size_t i = 0; i < points; ++i) good &= s[i] <= s[i + 1];
    if (!good) throw std::invalid_argument("arc must rise from 0 to a length above 0");
}

inline void check_indices(const std::int64_t *indices, std::size_t count, std::size_t points) {
    for (std::size_t i = 0; i < count; ++i)
        if (indices[i] < 0 || indices[i] >= static_cast<std::int64_t>(points))
            throw std::invalid_argument("index out of range");
}

inline void check_power_of_2(std::int64_t count) {
    if (count < 4 || count > 65536 || (count & (count - 1)) != 0)
        throw std::invalid_argument("count must be a power of 2, from 4 to 65536, not " + std::to_string(count));
}

template <typename Value> constexpr const char *type_name() {
    if constexpr (std::is_same_v<Value, bool>) return "bool";
    else if constexpr (std::is_same_v<Value, std::uint8_t>) return "uint8";
    else if constexpr (std::is_same_v<Value, std::int64_t>) return "int64";
    else if constexpr (std::is_same_v<Value, float>) return "float32";
    else {
        static_assert(std::is_same_v<Value, double>);
        return "float64";
    }
}

// A new array, made by NumPy: an nb::ndarray that is handed to NumPy takes twice as long.
template <typename Value = double> class Output {
  public:
    template <typename... Shape> explicit Output(Shape... shape) {
        static PyObject *const empty = nb::module_::import_("numpy").attr("empty").inc_ref().ptr();
        static PyObject *const dtype = nb::module_::import_("numpy").attr("dtype")(type_name<Value>()).inc_ref().ptr();
        const nb::tuple extent = nb::make_tuple(static_cast<std::size_t>(shape)...);
        PyObject *const arguments[] = {extent.ptr(), dtype};
        array_ = nb::steal(PyObject_Vectorcall(empty, arguments, 2, nullptr));
        Py_buffer buffer;
        if (!array_.is_valid() || PyObject_GetBuffer(array_.ptr(), &buffer, PyBUF_WRITABLE) != 0) nb::raise_python_error();
        data_ = static_cast<Value *>(buffer.buf);
        PyBuffer_Release(&buffer);
    }

    Value *values() { return data_; }
    Vec *vectors() { return reinterpret_cast<Vec *>(data_); }
    nb::object array() { return array_; }

  private:
    nb::object array_;
    Value *data_;
};

template <typename Value, typename... Shape> nb::object copied(const Value *values, Shape... shape) {
    Output<Value> out(shape...);
    std::copy(values, values + (static_cast<std::size_t>(shape) * ...), out.values());
    return out.array();
}
template <typename Value> nb::object copied(const std::vector<Value> &values) { return copied(values.data(), values.size()); }

// Makes named tuples of one class of grasptrack.kernels.results: as quick as plain ones.
class Record {
  public:
    explicit Record(const char *name)
        : type_(nb::module_::import_("grasptrack.kernels.results").attr(name).inc_ref().ptr()),
          allocate_(reinterpret_cast<allocfunc>(PyType_GetSlot(reinterpret_cast<PyTypeObject *>(type_), Py_tp_alloc))) {}

    template <typename... Values> nb::object operator()(Values &&...values) const {
        nb::object out = nb::steal(allocate_(reinterpret_cast<PyTypeObject *>(type_), sizeof...(Values)));
        if (!out.is_valid()) nb::raise_python_error();
        Py_ssize_t i = 0;
        (PyTuple_SetItem(out.ptr(), i++, nb::cast(std::forward<Values>(values)).release().ptr()), ...);
        return out;
    }

  private:
    PyObject *type_;
    allocfunc allocate_;
};

}  // namespace grasptrack
