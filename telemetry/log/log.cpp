#include "telemetry/log/log.h"

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <memory>

#include "telemetry/log/printable.h"

namespace tessera {

namespace {

spdlog::level::level_enum spdlog_level(LogLevel level) {
  switch (level) {
    case LogLevel::debug:
      return spdlog::level::debug;
    case LogLevel::warn:
      return spdlog::level::warn;
    case LogLevel::error:
      return spdlog::level::err;
    default:
      return spdlog::level::info;
  }
}

}  // namespace

std::vector<std::string> log_level_names() {
  return {"error", "warn", "info", "debug"};
}

LogLevel log_level(const std::string& name) {
  if (name == "error") return LogLevel::error;
  if (name == "warn") return LogLevel::warn;
  return name == "debug" ? LogLevel::debug : LogLevel::info;
}

Log open_log(const std::string& program, const std::string& level) {
  auto logger =
      std::make_shared<spdlog::logger>(program, std::make_shared<spdlog::sinks::stderr_sink_mt>());
  logger->set_pattern("%Y-%m-%dT%H:%M:%S.%e %n %l: %v");
  logger->set_level(spdlog_level(log_level(level)));
  logger->flush_on(spdlog::level::debug);
  return [logger](LogLevel of, const std::string& message) {
    logger->log(spdlog_level(of), "{}", printable(message));
  };
}

}  // namespace tessera
