#include "telemetry/log/log.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <functional>
#include <regex>
#include <set>
#include <sstream>
#include <string>

namespace tessera {
namespace {

/// Returns what `write` logs at `level`, as it appears on stderr.
std::string written_by(const std::string& level, const std::function<void(const Log&)>& write) {
  std::FILE* const file = std::tmpfile();
  const int real = ::dup(STDERR_FILENO);
  ::dup2(::fileno(file), STDERR_FILENO);
  write(open_log("tessera-test", level));
  std::fflush(stderr);
  ::dup2(real, STDERR_FILENO);
  ::close(real);
  std::rewind(file);
  std::string text(4096, '\0');
  text.resize(std::fread(text.data(), 1, text.size(), file));
  std::fclose(file);
  return text;
}

/// Returns the output when a line of each level is logged at `level`.
std::string written_at(const std::string& level) {
  return written_by(level, [](const Log& log) {
    log(LogLevel::debug, "d");
    log(LogLevel::info, "i {} %s");
    log(LogLevel::warn, "w");
    log(LogLevel::error, "e");
  });
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

TEST(Log, LineBreaksInMessagesMakeNoNewLines) {
  const std::string forged = written_by("error", [](const Log& log) {
    log(LogLevel::error, "job a\n2026-01-01T00:00:00.000 tessera-server info: job b is done");
  });
  EXPECT_EQ(std::count(forged.begin(), forged.end(), '\n'), 1) << forged;
}

TEST(Log, LevelNamesMatchOption) {
  std::set<std::string> different;
  for (const std::string& name : log_level_names()) different.insert(lines_at(name));
  EXPECT_EQ(different.size(), 4u);
}

}  // namespace
}  // namespace tessera
