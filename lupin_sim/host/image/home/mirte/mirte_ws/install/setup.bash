# Does what the vendor's colcon hook does: it sets the DDS variables and overwrites any values they had.
case "${MIRTE_FASTDDS:-false}" in
  false) unset ROS_DISCOVERY_SERVER FASTRTPS_DEFAULT_PROFILES_FILE ;;
  true) export ROS_DISCOVERY_SERVER=127.0.0.1 ;;
  *) export ROS_DISCOVERY_SERVER="$MIRTE_FASTDDS" ;;
esac
if [ -n "${ROS_DISCOVERY_SERVER:-}" ]; then
  _mirte_profile="$(dirname "${BASH_SOURCE[0]}")/super_client.xml"
  [ -w "$(dirname "$_mirte_profile")" ] || _mirte_profile="$(mktemp -d)/super_client.xml"
  cat > "$_mirte_profile" <<XML
<?xml version="1.0" encoding="UTF-8" ?>
<dds>
  <profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
    <participant profile_name="super_client_profile" is_default_profile="true">
      <rtps>
        <builtin>
          <discovery_config>
            <discoveryProtocol>SUPER_CLIENT</discoveryProtocol>
            <discoveryServersList>
              <RemoteServer prefix="44.53.00.5f.45.50.52.4f.53.49.4d.41">
                <metatrafficUnicastLocatorList>
                  <locator><udpv4><address>${ROS_DISCOVERY_SERVER%%:*}</address><port>11811</port></udpv4></locator>
                </metatrafficUnicastLocatorList>
              </RemoteServer>
            </discoveryServersList>
          </discovery_config>
        </builtin>
      </rtps>
    </participant>
  </profiles>
</dds>
XML
  export FASTRTPS_DEFAULT_PROFILES_FILE="$_mirte_profile"
  unset _mirte_profile
fi
