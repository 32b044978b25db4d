#include "rpc/channel.h"

#include <grpcpp/create_channel.h>

#include "absl/status/status.h"
#include "absl/strings/match.h"
#include "absl/strings/str_cat.h"
#include "rpc/credentials.h"

namespace tessera::contract {
namespace {

constexpr int kKeepalivePeriodMs = 1500;
constexpr int kInteractiveTimeoutMs = 3000, kBulkTimeoutMs = 10'000;

std::string host_of(const std::string& address) {
  if (absl::StartsWith(address, "[")) return address.substr(0, address.find(']') + 1);
  return address.substr(0, address.rfind(':'));
}

}  // namespace

bool is_local_address(const std::string& address) {
  if (absl::StartsWith(address, "unix:")) return true;
  const std::string host = host_of(address);
  if (host == "localhost" || host == "[::1]") return true;
  // 127.0.0.0/8 in digits; 127.example is a host name.
  return absl::StartsWith(host, "127.") &&
         host.find_first_not_of("0123456789.") == std::string::npos;
}

absl::StatusOr<std::shared_ptr<grpc::Channel>> open_channel(const std::string& address,
                                                            const std::string& certs,
                                                            Keepalive keepalive) {
  const bool has_tls = !certs.empty() && !absl::StartsWith(address, "unix:");
  if (!has_tls && !is_local_address(address)) {
    return absl::InvalidArgumentError(
        absl::StrCat("server ", address, " is on another machine: pass --certs DIR, the directory ",
                     "that `tessera-server issue-cert` created for you"));
  }
  auto credentials = has_tls ? channel_credentials(certs) : grpc::InsecureChannelCredentials();
  if (!credentials.ok()) return credentials.status();
  return open_channel(address, *credentials, keepalive);
}

std::shared_ptr<grpc::Channel> open_channel(
    const std::string& address, const std::shared_ptr<grpc::ChannelCredentials>& credentials,
    Keepalive keepalive) {
  grpc::ChannelArguments arguments;
  arguments.SetInt(GRPC_ARG_ENABLE_HTTP_PROXY, 0);
  arguments.SetMaxReceiveMessageSize(kMaxMessageBytes);
  arguments.SetMaxSendMessageSize(kMaxMessageBytes);
  arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 100);
  // Despite its name this is also the connection timeout; 100 ms is too short on a busy machine.
  arguments.SetInt(GRPC_ARG_MIN_RECONNECT_BACKOFF_MS, 5000);
  arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 2000);
  if (!absl::StartsWith(address, "unix:")) {
    arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, kKeepalivePeriodMs);
    arguments.SetInt(GRPC_ARG_KEEPALIVE_TIMEOUT_MS,
                     keepalive == Keepalive::bulk ? kBulkTimeoutMs : kInteractiveTimeoutMs);
    arguments.SetInt(GRPC_ARG_HTTP2_MAX_PINGS_WITHOUT_DATA, 0);  // no maximum
  }
  // By default the channels of a process share connections; a worker needs its own.
  arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
  return grpc::CreateCustomChannel(address, credentials, arguments);
}

bool is_refused_for_now(const grpc::ClientContext& context) {
  return context.GetServerTrailingMetadata().count(kRetryKey) > 0;
}

void prepare_call(grpc::ClientContext& context, const std::string& token,
                  std::chrono::milliseconds timeout) {
  if (timeout.count() > 0) context.set_deadline(std::chrono::system_clock::now() + timeout);
  if (!token.empty()) context.AddMetadata(kTokenKey, token);
}

}  // namespace tessera::contract
