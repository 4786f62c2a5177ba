// SPDX-License-Identifier: Apache-2.0
// Room for one call's intermediate results, kept from call to call.
#pragma once

#include <cstddef>
#include <memory>
#include <utility>

namespace grasptrack {

// An array that is not initialised. Its memory goes back to the thread and not to the system, which would have to clear
// every page of it again for the next call: with long outlines that costs more than the arithmetic.
template <typename Value> class Scratch {
    struct Room {
        std::unique_ptr<Value[]> values;
        std::size_t size = 0;
    };

  public:
    explicit Scratch(std::size_t size) : room_(std::exchange(kept(), Room{})) {
        if (room_.size < size) room_ = {std::unique_ptr<Value[]>(new Value[size]), size};
    }
    ~Scratch() { kept() = std::move(room_); }
    Scratch(const Scratch &) = delete;
    Scratch &operator=(const Scratch &) = delete;

    Value *get() const { return room_.values.get(); }
    Value &operator[](std::size_t i) const { return room_.values[i]; }

  private:
    static Room &kept() {
        thread_local Room room;
        return room;
    }

    Room room_;
};

}  // namespace grasptrack
