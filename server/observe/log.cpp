#include "server/observe/log.h"

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <memory>

namespace tessera::server {

std::function<void(const std::string&)> open_log(const std::string& level) {
  auto logger = std::make_shared<spdlog::logger>("tessera-server",
                                                 std::make_shared<spdlog::sinks::stderr_sink_mt>());
  logger->set_pattern("%Y-%m-%dT%H:%M:%S.%e %n %l: %v");
  logger->set_level(level == "error"   ? spdlog::level::err
                    : level == "warn"  ? spdlog::level::warn
                    : level == "debug" ? spdlog::level::debug
                                       : spdlog::level::info);
  logger->flush_on(spdlog::level::info);
  return [logger](const std::string& message) { logger->info("{}", message); };
}

}  // namespace tessera::server
