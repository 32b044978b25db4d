#include "telemetry/log/log.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cstdio>
#include <regex>
#include <set>
#include <sstream>
#include <string>

namespace tessera {
namespace {

/// Returns the output on stderr when a line of each level is logged at `level`.
std::string written_at(const std::string& level) {
  std::FILE* const file = std::tmpfile();
  const int real = ::dup(STDERR_FILENO);
  ::dup2(::fileno(file), STDERR_FILENO);
  const Log log = open_log("tessera-test", level);
  log(LogLevel::debug, "d");
  log(LogLevel::info, "i {} %s");
  log(LogLevel::warn, "w");
  log(LogLevel::error, "e");
  std::fflush(stderr);
  ::dup2(real, STDERR_FILENO);
  ::close(real);
  std::rewind(file);
  std::string text(4096, '\0');
  text.resize(std::fread(text.data(), 1, text.size(), file));
  std::fclose(file);
  return text;
}

/// The lines without their required time stamps.
std::string lines_at(const std::string& level) {
  static const std::regex time(R"(\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3} )");
  std::istringstream text(written_at(level));
  std::string out, line;
  while (std::getline(text, line)) {
    std::smatch found;
    EXPECT_TRUE(std::regex_search(line, found, time) && found.position() == 0) << line;
    out += line.substr(found.length()) + "\n";
  }
  return out;
}

TEST(Log, WritesItsLevelAndAbove) {
  const std::string error = "tessera-test error: e\n", warn = "tessera-test warning: w\n" + error;
  const std::string info = "tessera-test info: i {} %s\n" + warn;
  EXPECT_EQ(lines_at("error"), error);
  EXPECT_EQ(lines_at("warn"), warn);
  EXPECT_EQ(lines_at("info"), info);
  EXPECT_EQ(lines_at("debug"), "tessera-test debug: d\n" + info);
  EXPECT_EQ(lines_at("loud"), info);
}

TEST(Log, LevelNamesMatchOption) {
  std::set<std::string> different;
  for (const std::string& name : log_level_names()) different.insert(lines_at(name));
  EXPECT_EQ(different.size(), 4u);
}

}  // namespace
}  // namespace tessera
