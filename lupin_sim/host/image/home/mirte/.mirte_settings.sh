export MIRTE_FASTDDS=true
