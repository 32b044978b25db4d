#include "proto/log/log.h"

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <memory>

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

Log open_log(const std::string& program, const std::string& level) {
  auto logger =
      std::make_shared<spdlog::logger>(program, std::make_shared<spdlog::sinks::stderr_sink_mt>());
  logger->set_pattern("%Y-%m-%dT%H:%M:%S.%e %n %l: %v");
  logger->set_level(level == "error"   ? spdlog::level::err
                    : level == "warn"  ? spdlog::level::warn
                    : level == "debug" ? spdlog::level::debug
                                       : spdlog::level::info);
  logger->flush_on(spdlog::level::debug);
  return [logger](LogLevel of, const std::string& message) {
    logger->log(spdlog_level(of), "{}", message);
  };
}

}  // namespace tessera
