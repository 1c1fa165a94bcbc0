"""The lab's certificates: one authority, and what it has issued to each identity. X.509 by `cryptography`; pure."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from ipaddress import ip_address

from cryptography import x509
from cryptography.exceptions import InvalidSignature, UnsupportedAlgorithm
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

AUTHORITY_LIFE, IDENTITY_LIFE = timedelta(days=3650), timedelta(days=365)
CLOCK_DOUBT = timedelta(days=1)
"""How far another machine's clock may be behind: a new certificate is valid there, too."""


@dataclass(frozen=True, slots=True)
class KeyPair:
    """A certificate and its private key, both PEM."""

    certificate: bytes
    private: bytes

    def __repr__(self) -> str:
        return "KeyPair(...)"  # the key is nobody's to see


def new_authority(lab: str, now: datetime) -> KeyPair:
    """The lab's own authority, self-signed, which may sign certificates of identities and no further authority."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = _name(f"{lab} authority")
    builder = (
        _builder(name, name, key.public_key(), now, AUTHORITY_LIFE)
        .add_extension(x509.BasicConstraints(ca=True, path_length=0), critical=True)
        .add_extension(_usage(signs_certificates=True), critical=True)
    )
    return _issued(builder, key, key)


def new_identity(authority: KeyPair, identity: str, hosts: Sequence[str], now: datetime) -> KeyPair:
    """A certificate of an identity. hosts: the names and addresses by which others connect to it."""
    issuer, issuer_key = x509.load_pem_x509_certificate(authority.certificate), _key(authority)
    key = ec.generate_private_key(ec.SECP256R1())
    usages = x509.ExtendedKeyUsage([ExtendedKeyUsageOID.SERVER_AUTH, ExtendedKeyUsageOID.CLIENT_AUTH])
    builder = (
        _builder(issuer.subject, _name(identity), key.public_key(), now, IDENTITY_LIFE)
        .add_extension(x509.BasicConstraints(ca=False, path_length=None), critical=True)
        .add_extension(_usage(signs_certificates=False), critical=True)
        .add_extension(usages, critical=False)
        .add_extension(x509.SubjectAlternativeName([_host(host) for host in hosts]), critical=False)
        .add_extension(x509.AuthorityKeyIdentifier.from_issuer_public_key(issuer_key.public_key()), critical=False)
    )
    return _issued(builder, key, issuer_key)


def expiry(certificate: bytes) -> datetime:
    """When a certificate ends, UTC."""
    return x509.load_pem_x509_certificate(certificate).not_valid_after_utc


def hosts_in(certificate: bytes) -> set[str]:
    """The names and addresses by which others may connect to a certificate's identity."""
    names = x509.load_pem_x509_certificate(certificate).extensions.get_extension_for_class(x509.SubjectAlternativeName)
    addresses = names.value.get_values_for_type(x509.IPAddress)
    return {*names.value.get_values_for_type(x509.DNSName), *map(str, addresses)}


def common_name(certificate: bytes) -> str:
    """The identity that a certificate names."""
    (name,) = x509.load_pem_x509_certificate(certificate).subject.get_attributes_for_oid(NameOID.COMMON_NAME)
    return str(name.value)


def fault_of(authority: str, certificate: str, private: str, name: str) -> str:
    """Why PEM texts are not the identity of that name; empty where they are."""
    try:
        issuer, issued = (x509.load_pem_x509_certificate(text.encode()) for text in (authority, certificate))
        key = serialization.load_pem_private_key(private.encode(), None)
        issued.verify_directly_issued_by(issuer)
    except (ValueError, TypeError, InvalidSignature, UnsupportedAlgorithm) as error:
        return str(error) or "the authority has not signed the certificate"
    if key.public_key() != issued.public_key():
        return "the private key is not the certificate's"
    return "" if common_name(certificate.encode()) == name else "the certificate is of another name"


def _builder(
    issuer: x509.Name, subject: x509.Name, key: ec.EllipticCurvePublicKey, now: datetime, life: timedelta
) -> x509.CertificateBuilder:
    return (
        x509.CertificateBuilder()
        .issuer_name(issuer)
        .subject_name(subject)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - CLOCK_DOUBT)
        .not_valid_after(now + life)
        .add_extension(x509.SubjectKeyIdentifier.from_public_key(key), critical=False)
    )


def _issued(
    builder: x509.CertificateBuilder, key: ec.EllipticCurvePrivateKey, issuer_key: ec.EllipticCurvePrivateKey
) -> KeyPair:
    certificate = builder.sign(issuer_key, hashes.SHA256()).public_bytes(serialization.Encoding.PEM)
    private = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    return KeyPair(certificate, private)


def _key(issued: KeyPair) -> ec.EllipticCurvePrivateKey:
    key = serialization.load_pem_private_key(issued.private, None)
    if not isinstance(key, ec.EllipticCurvePrivateKey):
        raise ValueError("the authority's private key is of another kind than the lab's keys are")
    return key


def _name(text: str) -> x509.Name:
    return x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, text)])


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _usage(*, signs_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=not signs_certificates, key_cert_sign=signs_certificates, crl_sign=signs_certificates,
        content_commitment=False, key_encipherment=False, data_encipherment=False, key_agreement=False,
        encipher_only=False, decipher_only=False,
    )  # fmt: skip
