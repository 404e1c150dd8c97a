#pragma once
/// Words of --help that belong to no option, and how lines of it are broken.
#include <cstddef>
#include <string>
#include <string_view>

namespace lmc {

extern const char* const kFixedLimits;  ///< that no option moves
extern const char* const kExitCodes;

/// The same words in lines of at most so many columns; a longer word has a line of its own.
std::string wrapped(std::string_view text, std::size_t columns);

}  // namespace lmc
