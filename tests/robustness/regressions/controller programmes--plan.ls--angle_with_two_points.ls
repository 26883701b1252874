/PROG  PLAN
/ATTR
OWNER		= MNEDITOR;
COMMENT		= "qsf export";
LINE_COUNT	= 41;
PROTECT		= READ_WRITE;
TCD:  STACK_SIZE	= 0,
      TASK_PRIORITY	= 50,
      TIME_SLICE	= 0,
      BUSY_LAMP_OFF	= 0,
      ABORT_REQUEST	= 0,
      PAUSE_REQUEST	= 0;
DEFAULT_GROUP	= 1,*,*,*,*;
CONTROL_CODE	= 00000000 00000000;
/MN
   1:  !robot fanuc_m900ib ;
   2:  !payload 700 kg ;
   3:  !set PAYLOAD of tool and weight ;
   4:  UFRAME_NUM=0 ;
   5:  UTOOL_NUM=1 ;
   6:  !row01 visit 1 ;
   7:J P[1] 10% FINE    ;
   8:  WAIT   5.00(sec) ;
   9:  !row02 visit 1 ;
  10:J P[2] 10% FINE    ;
  11:  WAIT   5.00(sec) ;
  12:  !row03 visit 1 ;
  13:J P[3] 10% FINE    ;
  14:  WAIT   5.00(sec) ;
  15:  !row04 visit 1 ;
  16:J P[4] 10% FINE    ;
  17:  WAIT   5.00(sec) ;
  18:  !row05 visit 1 ;
  19:J P[5] 10% FINE    ;
  20:  WAIT   5.00(sec) ;
  21:  !row06 visit 1 ;
  22:J P[6] 10% FINE    ;
  23:  WAIT   5.00(sec) ;
  24:  !row07 visit 1 ;
  25:J P[7] 10% FINE    ;
  26:  WAIT   5.00(sec) ;
  27:  !row08 visit 1 ;
  28:J P[8] 10% FINE    ;
  29:  WAIT   5.00(sec) ;
  30:  !row09 visit 1 ;
  31:J P[9] 10% FINE    ;
  32:  WAIT   5.00(sec) ;
  33:  !row10 visit 1 ;
  34:J P[10] 10% FINE    ;
  35:  WAIT   5.00(sec) ;
  36:  !row11 visit 1 ;
  37:J P[11] 10% FINE    ;
  38:  WAIT   5.00(sec) ;
  39:  !row12 visit 1 ;
  40:J P[12] 10% FINE    ;
  41:  WAIT   5.00(sec) ;
/POS
P[1:"row01"]{
   GP1:
	UF : 0, UT : 1,	
	J1=     0.000 deg,	J2=    9.0.0 deg,	J3=   -30.000 deg,
	J4=   -45.000 deg,	J5=    30.000 deg,	J6=   135.000 deg
};
P[2:"row02"]{
   GP1:
	UF : 0, UT : 1,	
	J1=     0.000 deg,	J2=    90.000 deg,	J3=   -30.000 deg,
	J4=    45.000 deg,	J5=   -30.000 deg,	J6=   135.000 deg
};
P[3:"row03"]{
   GP1:
	UF : 0, UT : 1,	
	J1=    90.000 deg,	J2=    90.000 deg,	J3=    30.000 deg,
	J4=   -45.000 deg,	J5=   -30.000 deg,	J6=   -45.000 deg
};
P[4:"row04"]{
   GP1:
	UF : 0, UT : 1,	
	J1=    90.000 deg,	J2=    90.000 deg,	J3=    30.000 deg,
	J4=    45.000 deg,	J5=   -30.000 deg,	J6=    45.000 deg
};
P[5:"row05"]{
   GP1:
	UF : 0, UT : 1,	
	J1=   180.000 deg,	J2=    55.000 deg,	J3=   -30.000 deg,
	J4=   135.000 deg,	J5=   -30.000 deg,	J6=   -45.000 deg
};
P[6:"row06"]{
   GP1:
	UF : 0, UT : 1,	
	J1=  -180.000 deg,	J2=    55.000 deg,	J3=   -30.000 deg,
	J4=   -45.000 deg,	J5=    30.000 deg,	J6=   135.000 deg
};
P[7:"row07"]{
   GP1:
	UF : 0, UT : 1,	
	J1=   -90.000 deg,	J2=    55.000 deg,	J3=    30.000 deg,
	J4=   135.000 deg,	J5=    30.000 deg,	J6=   135.000 deg
};
P[8:"row08"]{
   GP1:
	UF : 0, UT : 1,	
	J1=   -90.000 deg,	J2=    55.000 deg,	J3=    30.000 deg,
	J4=   -45.000 deg,	J5=   -30.000 deg,	J6=   -45.000 deg
};
P[9:"row09"]{
   GP1:
	UF : 0, UT : 1,	
	J1=     0.000 deg,	J2=   -30.000 deg,	J3=   -30.000 deg,
	J4=  -135.000 deg,	J5=    30.000 deg,	J6=  -135.000 deg
};
P[10:"row10"]{
   GP1:
	UF : 0, UT : 1,	
	J1=     0.000 deg,	J2=   -30.000 deg,	J3=   -30.000 deg,
	J4=   135.000 deg,	J5=   -30.000 deg,	J6=   -45.000 deg
};
P[11:"row11"]{
   GP1:
	UF : 0, UT : 1,	
	J1=   180.000 deg,	J2=   -30.000 deg,	J3=    30.000 deg,
	J4=  -135.000 deg,	J5=    30.000 deg,	J6=  -135.000 deg
};
P[12:"row12"]{
   GP1:
	UF : 0, UT : 1,	
	J1=  -180.000 deg,	J2=   -30.000 deg,	J3=    30.000 deg,
	J4=   135.000 deg,	J5=    30.000 deg,	J6=   135.000 deg
};
/END
