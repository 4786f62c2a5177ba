// SPDX-License-Identifier: Apache-2.0
// NumPy arrays, seen and made by NumPy's own C interface. Its layout and the numbers of its functions are fixed by its
// ABI, the same for NumPy 1 and 2; written down here, as pybind11 does, they save a build from needing its headers.
// A call with three arrays in and one out took 0.2 us this way, and 0.7 us by nanobind's buffers and numpy.empty.
#pragma once

#include <nanobind/nanobind.h>

#include <cstdint>
#include <stdexcept>
#include <type_traits>

namespace grasptrack {

namespace nb = nanobind;

class NumPy {
  public:
    struct Descr {
        PyObject_HEAD
        PyObject *scalar;
        char kind, type, byte_order, flags;
        int number;
    };
    struct Array {
        PyObject_HEAD
        void *data;
        int dimensions;
        Py_ssize_t *shape, *strides;
        PyObject *base;
        Descr *descr;
        int flags;
    };
    static constexpr int usable = 0x0001 | 0x0100;  // C order, aligned

    static const NumPy &get() {
        static const NumPy *const numpy = new NumPy;  // kept for the life of the process, as NumPy itself is
        return *numpy;
    }

    bool is_array(PyObject *object) const { return PyObject_TypeCheck(object, type_) != 0; }

    PyObject *make(int dimensions, const Py_ssize_t *shape, int number) const {
        return new_(type_, dimensions, shape, number, nullptr, nullptr, 0, 0, nullptr);
    }

    // The array in C order and of the wanted type, a copy.
    nb::object converted(PyObject *array, int number) const {
        const char *name = number == 0 ? "bool" : (number == 12 ? "float64" : "int64");
        return nb::module_::import_("numpy").attr("ascontiguousarray")(nb::handle(array), name);
    }

  private:
    using New = PyObject *(*)(PyTypeObject *, int, const Py_ssize_t *, int, const Py_ssize_t *, void *, int, int,
                              PyObject *);

    NumPy() {
        nb::object module;
        try {
            module = nb::module_::import_("numpy._core._multiarray_umath");
        } catch (nb::python_error &) {
            module = nb::module_::import_("numpy.core._multiarray_umath");  // NumPy 1
        }
        void **functions = static_cast<void **>(PyCapsule_GetPointer(module.attr("_ARRAY_API").ptr(), nullptr));
        if (!functions) nb::raise_python_error();
        const unsigned version = reinterpret_cast<unsigned (*)()>(functions[0])() >> 24;
        if (version != 1 && version != 2) throw std::runtime_error("this NumPy's binary interface is not known");
        type_ = static_cast<PyTypeObject *>(functions[2]);
        new_ = reinterpret_cast<New>(functions[93]);
    }

    PyTypeObject *type_;
    New new_;
};

// NumPy's number of an element type.
template <typename Value> constexpr int type_number() {
    static_assert(std::is_same_v<Value, double> || std::is_same_v<Value, std::int64_t> || std::is_same_v<Value, bool>);
    if (std::is_same_v<Value, double>) return 12;
    if (std::is_same_v<Value, bool>) return 0;
    return sizeof(long) == 8 ? 7 : 9;
}

// An array that was passed in: C order, of the given number of dimensions; 2 columns where Columns says so.
template <typename Value, int Dimensions, int Columns = 0> class Input {
  public:
    const Value *data() const { return static_cast<const Value *>(array()->data); }
    std::size_t shape(int axis) const { return static_cast<std::size_t>(array()->shape[axis]); }

    bool take(PyObject *object, bool convert) {
        const NumPy &numpy = NumPy::get();
        if (!numpy.is_array(object)) return false;
        held_ = nb::borrow(object);
        if (array()->dimensions != Dimensions || (Columns != 0 && array()->shape[1] != Columns)) return false;
        if (fits()) return true;
        if (!convert) return false;
        held_ = numpy.converted(object, type_number<Value>());
        return fits();
    }

  private:
    const NumPy::Array *array() const { return reinterpret_cast<const NumPy::Array *>(held_.ptr()); }

    bool fits() const {
        const NumPy::Descr &descr = *array()->descr;
        const bool same = descr.number == type_number<Value>() ||
                          (std::is_same_v<Value, std::int64_t> && descr.number == 9);  // long long
        return same && descr.byte_order != '>' && (array()->flags & NumPy::usable) == NumPy::usable;
    }

    nb::object held_;
};

// A new array.
template <typename Value> class OutputOf {
  public:
    explicit OutputOf(std::size_t size) {
        const Py_ssize_t shape[] = {static_cast<Py_ssize_t>(size)};
        make(1, shape);
    }
    OutputOf(std::size_t rows, std::size_t columns) {
        const Py_ssize_t shape[] = {static_cast<Py_ssize_t>(rows), static_cast<Py_ssize_t>(columns)};
        make(2, shape);
    }

    Value *values() { return data_; }
    nb::object array() { return std::move(array_); }

  private:
    void make(int dimensions, const Py_ssize_t *shape) {
        array_ = nb::steal(NumPy::get().make(dimensions, shape, type_number<Value>()));
        if (!array_.is_valid()) nb::raise_python_error();
        data_ = static_cast<Value *>(reinterpret_cast<NumPy::Array *>(array_.ptr())->data);
    }

    nb::object array_;
    Value *data_ = nullptr;
};

}  // namespace grasptrack

template <typename Element, int Dimensions, int Columns>
struct nanobind::detail::type_caster<grasptrack::Input<Element, Dimensions, Columns>> {
    using Array = grasptrack::Input<Element, Dimensions, Columns>;
    NB_TYPE_CASTER(Array, const_name("numpy.ndarray"))

    bool from_python(handle source, std::uint8_t flags, cleanup_list *) noexcept {
        try {
            return value.take(source.ptr(), (flags & static_cast<std::uint8_t>(cast_flags::convert)) != 0);
        } catch (...) {
            PyErr_Clear();
            return false;
        }
    }
};
