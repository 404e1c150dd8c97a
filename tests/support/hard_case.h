#pragma once
/// Rows of docs/stability.md: a hard case, what was measured, and the limit that its test derives. A row is an assertion, too.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>

#include <fmt/format.h>

namespace lmc::test {

struct HardCase {
  std::string what;     ///< "level moved by 1e5 m"
  std::string measure;  ///< "RMS difference"
  double figure = 0.0, limit = 0.0;
  std::string unit;     ///< "%" shows shares in percent
  std::string because;  ///< where the limit comes from
};

/// Fails unless figure <= limit; appends the row to a file of the running test in the folder LMC_STABILITY_ROWS, where there is one
/// (scripts/stability-table makes the table of them).
inline void expectWithin(const HardCase& c) {
  EXPECT_LE(c.figure, c.limit) << c.what << ": " << c.measure << " [" << c.unit << "], limit " << c.because;
  const auto* test = testing::UnitTest::GetInstance()->current_test_info();
  const double factor = c.unit == "%" ? 100.0 : 1.0;
  const std::string unit = c.unit.empty() ? "" : " " + c.unit;
  const std::string name = fmt::format("{}.{}", test->test_suite_name(), test->name());
  const std::string row = fmt::format("| {} | {} | {:.2g}{} | {:.2g}{} | {} | `{}` |", c.what, c.measure, factor * c.figure, unit,
                                      factor * c.limit, unit, c.because, name);
  fmt::print("{}\n", row);
  const char* folder = std::getenv("LMC_STABILITY_ROWS");
  if (!folder) return;
  std::string file = name;
  for (char& letter : file)
    if (letter == '/') letter = '_';
  std::filesystem::create_directories(folder);
  std::ofstream(std::filesystem::path(folder) / (file + ".rows"), std::ios::app) << row << "\n";
}

}  // namespace lmc::test
