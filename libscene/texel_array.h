#pragma once
/// An array of one entry a texel: as a vector, but that it does not grow, begins as zeros that cost nothing until they are written, and
/// need not be in memory as a whole (paging.h).
#include <algorithm>
#include <cstddef>
#include <cstring>
#include <span>
#include <type_traits>
#include <utility>

#include "libscene/paging.h"

namespace lmc {

template <class T>
class TexelArray {
  static_assert(std::is_trivially_copyable_v<T> && std::is_trivially_destructible_v<T>);

 public:
  using value_type = T;
  using iterator = T*;
  using const_iterator = const T*;

  TexelArray() = default;
  /// Every byte 0.
  explicit TexelArray(std::size_t n) : block_(n * sizeof(T)), size_(n) {}
  TexelArray(std::size_t n, const T& value) : TexelArray(n) {
    constexpr unsigned char kZeros[sizeof(T)] = {};
    if (std::memcmp(&value, kZeros, sizeof(T)) != 0) std::fill(begin(), end(), value);
  }
  TexelArray(const TexelArray& other) : TexelArray(other.size_) { std::copy(other.begin(), other.end(), begin()); }
  TexelArray(TexelArray&& other) noexcept : block_(std::move(other.block_)), size_(std::exchange(other.size_, 0)) {}
  TexelArray& operator=(TexelArray other) noexcept {
    block_ = std::move(other.block_);
    std::swap(size_, other.size_);
    return *this;
  }
  /// What was there goes first: two are never held.
  void assign(std::size_t n, const T& value) {
    clear();
    *this = TexelArray(n, value);
  }
  void clear() { *this = TexelArray(); }

  T* data() { return static_cast<T*>(block_.data()); }
  const T* data() const { return static_cast<const T*>(block_.data()); }
  std::size_t size() const { return size_; }
  bool empty() const { return size_ == 0; }
  T& operator[](std::size_t i) { return data()[i]; }
  const T& operator[](std::size_t i) const { return data()[i]; }
  T* begin() { return data(); }
  T* end() { return data() + size_; }
  const T* begin() const { return data(); }
  const T* end() const { return data() + size_; }
  bool operator==(const TexelArray& other) const { return std::equal(begin(), end(), other.begin(), other.end()); }

 private:
  Block block_;
  std::size_t size_ = 0;
};

}  // namespace lmc
