#!/usr/bin/env python3
"""Make a keystore of SROS2 for the enclaves of a policy file: ``security_keystore.py KEYSTORE [--policy FILE]``.

What ``ros2 security generate_artifacts`` makes, with openssl alone, for machines without sros2: a certificate
authority, and for every enclave a key, a certificate, and permissions signed by the authority. Run it again after a
change of the policies: keys that are there are kept. Whoever has ``KEYSTORE/private`` can make an identity that may do
anything; keep it off the robot, which needs ``KEYSTORE/enclaves`` only.
"""
import argparse
import os
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ElementTree
from datetime import datetime, timedelta, timezone
from pathlib import Path
from xml.sax.saxutils import escape

POLICY = Path(__file__).resolve().parents[1] / 'config/security/policies.xml'
YEARS = 10
ALL_DOMAINS = '<domains><id_range><min>0</min><max>230</max></id_range></domains>'
HEAD = ('<?xml version="1.0" encoding="UTF-8"?>\n<dds xmlns:xsi="http://www.w3.org/2001/XMLSchema-instance" '
        'xsi:noNamespaceSchemaLocation="http://www.omg.org/spec/DDS-SECURITY/20170901/omg_shared_ca_{kind}.xsd">\n')
#: nobody joins without a certificate, everything is encrypted, and what is read and written needs a permission
GOVERNANCE = HEAD.format(kind='governance') + f"""\
<domain_access_rules><domain_rule>{ALL_DOMAINS}
<allow_unauthenticated_participants>false</allow_unauthenticated_participants>
<enable_join_access_control>true</enable_join_access_control>
<discovery_protection_kind>ENCRYPT</discovery_protection_kind>
<liveliness_protection_kind>ENCRYPT</liveliness_protection_kind>
<rtps_protection_kind>SIGN</rtps_protection_kind>
<topic_access_rules><topic_rule><topic_expression>*</topic_expression>
<enable_discovery_protection>true</enable_discovery_protection>
<enable_liveliness_protection>true</enable_liveliness_protection>
<enable_read_access_control>true</enable_read_access_control>
<enable_write_access_control>true</enable_write_access_control>
<metadata_protection_kind>ENCRYPT</metadata_protection_kind>
<data_protection_kind>ENCRYPT</data_protection_kind>
</topic_rule></topic_access_rules></domain_rule></domain_access_rules></dds>
"""


def openssl(*arguments, **options):
    """Run openssl; RuntimeError with its words where it fails."""
    done = subprocess.run(['openssl', *map(str, arguments)], capture_output=True, text=True, **options)
    if done.returncode:
        raise RuntimeError(f'openssl {arguments[0]}: {done.stderr.strip()}')


def dds_topics(enclave):
    """DDS topics an enclave may publish and subscribe, from its ROS names: two sorted lists.

    A topic ``/name`` is ``rt/name``; a service is ``rq/nameRequest`` and ``rr/nameReply``.
    """
    publish, subscribe = {'ros_discovery_info'}, {'ros_discovery_info'}
    for profile in enclave.iter('profile'):
        for topics in profile.iter('topics'):
            for way, names in (('publish', publish), ('subscribe', subscribe)):
                if topics.get(way) == 'ALLOW':
                    names.update('rt' + topic.text for topic in topics.iter('topic'))
        for services in profile.iter('services'):
            for way, asked, answered in (('reply', subscribe, publish), ('request', publish, subscribe)):
                if services.get(way) == 'ALLOW':
                    asked.update(f'rq{service.text}Request' for service in services.iter('service'))
                    answered.update(f'rr{service.text}Reply' for service in services.iter('service'))
    return sorted(publish), sorted(subscribe)


def permissions(path, publish, subscribe):
    """The permissions document of an enclave: what is listed, and nothing else."""
    def topics(names):
        return '<topics>' + ''.join(f'<topic>{escape(name)}</topic>' for name in names) + '</topics>'
    start = datetime.now(timezone.utc).replace(microsecond=0, tzinfo=None)
    return HEAD.format(kind='permissions') + f"""\
<permissions><grant name="{escape(path)}"><subject_name>CN={escape(path)}</subject_name>
<validity><not_before>{start.isoformat()}</not_before>
<not_after>{(start + timedelta(days=365 * YEARS)).isoformat()}</not_after></validity>
<allow_rule>{ALL_DOMAINS}
<publish>{topics(publish)}</publish>
<subscribe>{topics(subscribe)}</subscribe></allow_rule>
<default>DENY</default></grant></permissions></dds>
"""


def sign(document, keystore):
    """Sign ``NAME.xml`` to ``NAME.p7s`` beside it, with the authority of the keystore."""
    openssl('smime', '-sign', '-text', '-in', document, '-out', document.with_suffix('.p7s'), '-signer',
            keystore / 'public/permissions_ca.cert.pem', '-inkey', keystore / 'private/permissions_ca.key.pem')


def new_key(path):
    """A private key on the curve P-256, which nobody else may read."""
    openssl('ecparam', '-name', 'prime256v1', '-genkey', '-noout', '-out', path)
    path.chmod(0o600)


def make_authority(keystore):
    """The certificate authority of a new keystore; it signs identities and permissions."""
    private, public = keystore / 'private', keystore / 'public'
    for folder in (private, public, keystore / 'enclaves'):
        folder.mkdir(parents=True, exist_ok=True)
    private.chmod(0o700)
    key, certificate = private / 'ca.key.pem', public / 'ca.cert.pem'
    if not key.exists():
        new_key(key)
        openssl('req', '-x509', '-new', '-key', key, '-sha256', '-days', 365 * YEARS, '-subj', '/CN=sros2CA', '-out',
                certificate)
        for use in ('identity', 'permissions'):
            private.joinpath(f'{use}_ca.key.pem').symlink_to(key.name)
            public.joinpath(f'{use}_ca.cert.pem').symlink_to(certificate.name)
    governance = keystore / 'enclaves/governance.xml'
    governance.write_text(GOVERNANCE)
    sign(governance, keystore)


def make_enclave(keystore, path, publish, subscribe):
    """Key, certificate and signed permissions of one enclave."""
    folder = keystore / 'enclaves' / path.lstrip('/')  # of the enclave / that is the folder enclaves itself
    folder.mkdir(parents=True, exist_ok=True)
    for use in ('identity', 'permissions'):
        shutil.copy(keystore / f'public/{use}_ca.cert.pem', folder)
    if folder != keystore / 'enclaves':
        shutil.copy(keystore / 'enclaves/governance.p7s', folder)
    if not folder.joinpath('key.pem').exists():
        new_key(folder / 'key.pem')
    request = folder / 'request.pem'
    openssl('req', '-new', '-key', folder / 'key.pem', '-subj', '/CN=' + path.replace('/', r'\/'), '-out', request)
    openssl('x509', '-req', '-in', request, '-CA', keystore / 'public/identity_ca.cert.pem', '-CAkey',
            keystore / 'private/identity_ca.key.pem', '-CAcreateserial', '-CAserial', keystore / 'private/ca.srl',
            '-sha256', '-days', 365 * YEARS, '-out', folder / 'cert.pem')
    request.unlink()
    folder.joinpath('permissions.xml').write_text(permissions(path, publish, subscribe))
    sign(folder / 'permissions.xml', keystore)


def main(argv=None):
    """Exit status 0, or 1 with one line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument('keystore', type=Path)
    parser.add_argument('--policy', type=Path, default=POLICY, help='policy file of SROS2 (default: %(default)s)')
    args = parser.parse_args(argv)
    os.umask(0o077)
    try:
        enclaves = ElementTree.parse(args.policy).findall('.//enclave')
        make_authority(args.keystore)
        for enclave in enclaves:
            make_enclave(args.keystore, enclave.get('path'), *dds_topics(enclave))
    except (OSError, RuntimeError, ElementTree.ParseError) as error:
        print(f'No keystore: {error}', file=sys.stderr)
        return 1
    print(f'{len(enclaves)} enclaves in {args.keystore}:', *(enclave.get('path') for enclave in enclaves))
    print('export ROS_SECURITY_ENABLE=true ROS_SECURITY_STRATEGY=Enforce '
          f'ROS_SECURITY_KEYSTORE={args.keystore.resolve()}')
    return 0


if __name__ == '__main__':
    sys.exit(main())
