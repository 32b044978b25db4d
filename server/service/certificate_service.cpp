#include "server/service/certificate_service.h"

#include <chrono>
#include <cstdint>

#include "absl/strings/str_cat.h"
#include "rpc/rpc_status.h"
#include "server/identity/authority.h"
#include "server/service/finish.h"

namespace tessera::server {
namespace {

constexpr std::size_t kMaxRequestBytes = 16 << 10;
/// Number of times that one certificate may be renewed. Hosts that share it each renew their copy.
constexpr int kMaxRenewals = 1000;

std::int64_t now_s() {
  return std::chrono::duration_cast<std::chrono::seconds>(
             std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace

/// Bounds the growth of the list of issued certificates.
absl::Status CertificateService::count(const Identity& identity) {
  const MutexLock lock(mutex_);
  if (++renewals_[identity.serial] <= kMaxRenewals) return absl::OkStatus();
  return absl::ResourceExhaustedError(
      absl::StrCat("the certificate of ", identity_uri(identity.role, identity.name),
                   " has been renewed ", kMaxRenewals, " times; use the newest one"));
}

grpc::ServerUnaryReactor* CertificateService::RenewCertificate(
    grpc::CallbackServerContext* context, const v1::RenewCertificateRequest* request,
    v1::RenewCertificateResponse* response) {
  const auto caller = access_.admit(*context, "CertificateService.RenewCertificate");
  absl::Status status = caller.status();
  if (status.ok() && !caller->identity) {
    status = absl::FailedPreconditionError("callers of this server have no certificates");
  }
  if (status.ok() && request->signing_request().size() > kMaxRequestBytes) {
    status = absl::InvalidArgumentError("signing_request: more than 16384 bytes");
  }
  if (status.ok()) status = count(*caller->identity);
  if (!status.ok()) return finish(context, status);
  grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
  io_.post([this, reactor, request, response, identity = *caller->identity] {
    const auto renewed = renew(certs_, identity, request->signing_request(), now_s());
    if (renewed.ok()) response->set_certificate(*renewed);
    reactor->Finish(contract::to_rpc(renewed.status()));
  });
  return reactor;
}

}  // namespace tessera::server
